//! `overfly watch --html`: the plan page of a scene, live, for browsers on this machine.

mod board;
mod editor;
mod follow;
mod orders;
mod replies;
mod rules;
mod scenes;
mod server;

use std::sync::Arc;

use rustix::rand::{GetRandomFlags, getrandom};
use serde_json::json;

use self::board::Board;
use self::editor::Editor;
use self::rules::Gate;
use self::server::Server;
use super::answer::{Answer, Form};
use super::arguments::WatchArgs;
use super::failure::Failure;
use super::{browser, daemon};

/// Serves the page until the program is ended.
pub fn run(arguments: &WatchArgs, port: u16, form: Form) -> Result<(), Failure> {
    let scene = &arguments.scene;
    let domain = daemon::domain(arguments.reach.domain.as_deref())?;
    // A wrong name is told here and now; later the scene may come and go.
    daemon::connect(arguments.reach.domain.as_deref())?.watch(scene)?;
    let failed = |what: &str, cause: std::io::Error| Failure::Unexpected(format!("{what}: {cause}"));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build();
    let runtime = runtime.map_err(|cause| failed("the page cannot be served", cause))?;
    let listener = runtime.block_on(server::bind(port)).map_err(|cause| Failure::Port { port, cause })?;
    let port = listener.local_addr().map_err(|cause| failed("the port cannot be told", cause))?.port();

    let board = Arc::new(Board::new());
    let no_thread = |cause| failed("no thread can be started", cause);
    follow::start(domain.clone(), scene.clone(), Arc::clone(&board)).map_err(no_thread)?;
    let editor = Editor::start(domain, scene.clone(), Arc::clone(&board)).map_err(no_thread)?;
    let gate = Gate { port, token: secret()? };
    let (page, policy) = scenes::page(scene, &gate.token, &secret()?);
    let server = Server { page: page.into(), policy, run: secret()?, gate, board, editor };

    let address = format!("http://127.0.0.1:{port}/");
    let text = format!("{scene} is shown at {address}; Ctrl-C ends it");
    form.print(&Answer { text, json: json!({ "scene": scene, "address": address, "port": port }) }).map_err(Failure::Print)?;
    if let Some(Err(cause)) = arguments.open.then(|| browser::open(&address)) {
        form.remark(&format!("note: no browser can be opened ({cause}); open the address yourself"));
    }
    runtime.block_on(server::serve(listener, Arc::new(server)));
    Ok(())
}

/// 128 bits that nobody can guess, in hexadecimal.
fn secret() -> Result<String, Failure> {
    let mut bytes = [0; 16];
    let filled = getrandom(&mut bytes, GetRandomFlags::empty());
    match filled {
        Ok(16) => Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect()),
        other => Err(Failure::Unexpected(format!(
            "the system gives no random numbers ({other:?}), without which the page is not safe"
        ))),
    }
}
