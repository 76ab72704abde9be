//! Connections: each request is judged, answered, and nothing that comes over one disturbs the others.

use std::convert::Infallible;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use http_body_util::channel::{Channel, Sender};
use http_body_util::combinators::BoxBody;
use http_body_util::{BodyExt, LengthLimitError, Limited};
use hyper::body::{Body, Bytes};
use hyper::header::CONTENT_TYPE;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use serde_json::json;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;

use super::board::{Board, View, event};
use super::editor::Editor;
use super::orders::Order;
use super::replies::{Reply, guard};
use super::rules::{Gate, MOST_BYTES, Refusal, Route, too_large};

/// Connections at the same time; further ones are closed at once.
const MOST_CONNECTIONS: usize = 64;
/// How long a request's head and its body may take.
const PATIENCE: Duration = Duration::from_secs(10);
/// A stream on which nothing else is said says so often that it is still there.
const HEARTBEAT: Duration = Duration::from_secs(5);
/// Most bytes of a request's head.
const MOST_HEAD_BYTES: usize = 32 * 1024;

/// A page that takes nothing for so long has lost its place; one that is alive asks for another by itself.
const SILENCE: Duration = Duration::from_secs(60);

/// Messages that wait for a page that reads slowly; what is newer by then is taken instead.
const WAITING: usize = 1;

type Answer = Response<BoxBody<Bytes, Infallible>>;

/// Everything that requests are answered from.
pub struct Server {
    pub gate: Gate,
    pub board: Arc<Board>,
    pub editor: Editor,
    /// The page, its policy for browsers, and a word that tells this run of the server from others.
    pub page: Bytes,
    pub policy: String,
    pub run: String,
}

/// Takes the port, on this machine alone; 0 takes one that is free.
pub async fn bind(port: u16) -> std::io::Result<TcpListener> {
    TcpListener::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, port))).await
}

/// Answers until the program ends.
pub async fn serve(listener: TcpListener, server: Arc<Server>) {
    let places = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // Too many open files, for example: others may be closed in a moment.
            tokio::time::sleep(Duration::from_millis(50)).await;
            continue;
        };
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else { continue };
        let server = Arc::clone(&server);
        tokio::spawn(async move {
            // A page that breaks off has nobody left to be told.
            let _ = converse(stream, server).await;
            drop(place);
        });
    }
}

async fn converse(stream: TcpStream, server: Arc<Server>) -> Result<(), hyper::Error> {
    let _ = stream.set_nodelay(true);
    let answer = service_fn(move |request| {
        let server = Arc::clone(&server);
        async move { Ok::<_, Infallible>(guard(server.answer(request).await)) }
    });
    let mut connection = http1::Builder::new();
    connection.timer(TokioTimer::new()).header_read_timeout(PATIENCE).max_buf_size(MOST_HEAD_BYTES);
    connection.serve_connection(TokioIo::new(stream), answer).await
}

impl Server {
    async fn answer<B>(&self, request: Request<B>) -> Answer
    where
        B: Body<Data = Bytes, Error: Into<Box<dyn std::error::Error + Send + Sync>>>,
    {
        match self.gate.judge(request.method(), request.uri(), request.headers()) {
            Ok(Route::Page) => whole(self.page()),
            Ok(Route::Events) => self.events(),
            Ok(Route::Edit) => match self.edit(request.into_body()).await {
                Ok(value) => whole(Reply::json(StatusCode::OK, &value)),
                Err(refusal) => whole(refusal.reply()),
            },
            Err(refusal) => whole(refusal.reply()),
        }
    }

    fn page(&self) -> Reply {
        let reply = Reply::new(StatusCode::OK, "text/html; charset=utf-8", self.page.clone());
        reply.with(hyper::header::CONTENT_SECURITY_POLICY, &self.policy)
    }

    fn events(&self) -> Answer {
        let (sender, body) = Channel::new(WAITING);
        let hello = event("hello", json!({ "run": self.run }).to_string().as_bytes());
        tokio::spawn(stream(sender, self.board.look(), hello));
        let mut response = Response::new(body.boxed());
        response.headers_mut().insert(CONTENT_TYPE, hyper::header::HeaderValue::from_static("text/event-stream"));
        response
    }

    async fn edit<B>(&self, body: B) -> Result<serde_json::Value, Refusal>
    where
        B: Body<Data = Bytes, Error: Into<Box<dyn std::error::Error + Send + Sync>>>,
    {
        let read = tokio::time::timeout(PATIENCE, Limited::new(body, MOST_BYTES).collect()).await;
        let late = |_| Refusal::new(StatusCode::REQUEST_TIMEOUT, "the edit did not come within ten seconds");
        let body = read.map_err(late)?.map_err(|error| match error.downcast_ref::<LengthLimitError>() {
            Some(_) => too_large(),
            None => Refusal::new(StatusCode::BAD_REQUEST, "the edit broke off"),
        })?;
        self.editor.make(Order::read(&body.to_bytes())?).await
    }
}

fn whole(reply: Reply) -> Answer {
    reply.into_response().map(BodyExt::boxed)
}

/// Sends a page what is new for as long as it listens.
async fn stream(mut page: Sender<Bytes, Infallible>, mut views: tokio::sync::watch::Receiver<View>, hello: Bytes) {
    if !takes(&mut page, hello).await {
        return;
    }
    let (mut status, mut shown) = (0, 0);
    loop {
        let view = views.borrow_and_update().clone();
        for event in view.newer_than(status, shown) {
            // While a slow page reads, the board goes on; then it gets what is newest.
            if !takes(&mut page, event).await {
                return;
            }
        }
        (status, shown) = (view.status.number, view.shown.number);
        match tokio::time::timeout(HEARTBEAT, views.changed()).await {
            Ok(Ok(())) => {}
            Ok(Err(_)) => return,
            Err(_) => {
                if !takes(&mut page, Bytes::from_static(b": still here\n\n")).await {
                    return;
                }
            }
        }
    }
}

async fn takes(page: &mut Sender<Bytes, Infallible>, event: Bytes) -> bool {
    matches!(tokio::time::timeout(SILENCE, page.send_data(event)).await, Ok(Ok(())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_that_reads_late_gets_the_newest_state_and_not_all_of_them() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        runtime.block_on(async {
            let board = Board::new();
            let (sender, mut body) = Channel::<Bytes, Infallible>::new(WAITING);
            let streamed = tokio::spawn(stream(sender, board.look(), event("hello", b"{}")));
            for number in 1..=100 {
                board.show(number.to_string().as_bytes());
                tokio::task::yield_now().await;
            }
            drop(board);
            let mut events = Vec::new();
            while let Some(frame) = body.frame().await {
                events.push(String::from_utf8(frame.unwrap().into_data().unwrap().to_vec()).unwrap());
            }
            streamed.await.unwrap();
            let shown: Vec<&String> = events.iter().filter(|event| event.starts_with("event: show")).collect();
            assert!(shown.len() <= 3 && shown.last().is_some_and(|last| last.contains("data: 100")), "{events:?}");
        });
    }
}
