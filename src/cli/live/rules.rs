//! Which requests are answered. The page may change a scene, so that whatever a browser can be made to send on behalf of another site, or under another
//! name of this machine, must do nothing.

use hyper::header::{ALLOW, AsHeaderName, CONTENT_LENGTH, CONTENT_TYPE, HOST, HeaderMap, ORIGIN};
use hyper::{Method, StatusCode, Uri};
use serde_json::json;

use super::replies::Reply;

/// The header that carries the token of the page. No page of another site can send it without being asked first whether it may.
pub const TOKEN_HEADER: &str = "x-overfly-token";

/// What browsers say about where a request comes from.
const FETCH_SITE: &str = "sec-fetch-site";

/// Most bytes of a request's body.
pub const MOST_BYTES: usize = 64 * 1024;

/// Where this server is, and what its page knows.
#[derive(Clone, Debug)]
pub struct Gate {
    pub port: u16,
    pub token: String,
}

/// What a request that keeps the rules asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Route {
    Page,
    Events,
    Edit,
}

/// Why a request is not answered as it wishes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    pub status: StatusCode,
    pub reason: String,
    /// The method that is answered instead.
    allowed: Option<&'static str>,
}

impl Refusal {
    pub fn new(status: StatusCode, reason: impl Into<String>) -> Self {
        Self { status, reason: reason.into(), allowed: None }
    }

    fn not_allowed(method: &'static str) -> Self {
        Self { allowed: Some(method), ..Self::new(StatusCode::METHOD_NOT_ALLOWED, format!("only {method} is answered here")) }
    }

    fn forbidden(reason: impl Into<String>) -> Self {
        Self::new(StatusCode::FORBIDDEN, reason)
    }

    /// As the page reads it.
    pub fn reply(&self) -> Reply {
        let reply = Reply::json(self.status, &json!({ "error": self.reason }));
        match self.allowed {
            Some(method) => reply.with(ALLOW, method),
            None => reply,
        }
    }
}

impl Gate {
    /// Judges everything about a request but its body.
    pub fn judge(&self, method: &Method, uri: &Uri, headers: &HeaderMap) -> Result<Route, Refusal> {
        self.check_host(uri, headers)?;
        self.check_origin(headers)?;
        let route = match (method, uri.path()) {
            (&Method::GET, "/") => return Ok(Route::Page),
            (&Method::GET, "/events") => Route::Events,
            (&Method::POST, "/edits") => Route::Edit,
            (_, "/" | "/events") => return Err(Refusal::not_allowed("GET")),
            (_, "/edits") => return Err(Refusal::not_allowed("POST")),
            _ => return Err(Refusal::new(StatusCode::NOT_FOUND, "there are /, /events and /edits")),
        };
        // A link may lead to the page from anywhere; what the page itself asks for comes from nowhere else.
        if !matches!(only(headers, FETCH_SITE)?, None | Some("same-origin" | "none")) {
            return Err(Refusal::forbidden("this is for the page of this server alone"));
        }
        if route == Route::Edit {
            self.check_edit(headers)?;
        }
        Ok(route)
    }

    /// Names that others let lead to this machine are none of this server.
    fn check_host(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), Refusal> {
        let names = self.names();
        let is_own = |name: &str| names.iter().any(|own| own.eq_ignore_ascii_case(name));
        let host = only(headers, HOST)?.ok_or_else(|| Refusal::forbidden("the request names no host"))?;
        if !is_own(host) || uri.authority().is_some_and(|authority| !is_own(authority.as_str())) {
            return Err(Refusal::forbidden(format!("this server is {} and no other host", names.join(" or "))));
        }
        Ok(())
    }

    fn check_origin(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let Some(origin) = only(headers, ORIGIN)? else { return Ok(()) };
        let is_own = self.names().iter().any(|own| origin.eq_ignore_ascii_case(&format!("http://{own}")));
        // The page under one of its names asks under that name.
        let host = only(headers, HOST)?.unwrap_or_default();
        if !is_own || !origin.to_ascii_lowercase().ends_with(&format!("//{}", host.to_ascii_lowercase())) {
            return Err(Refusal::forbidden("the request comes from a page of another origin"));
        }
        Ok(())
    }

    fn check_edit(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let token = only(headers, TOKEN_HEADER)?.ok_or_else(|| Refusal::forbidden("the token of the page is missing"))?;
        if !is_equal(token.as_bytes(), self.token.as_bytes()) {
            return Err(Refusal::forbidden("the token is not that of this server; load the page again"));
        }
        let kind = only(headers, CONTENT_TYPE)?.unwrap_or_default();
        if !kind.split(';').next().unwrap_or_default().trim().eq_ignore_ascii_case("application/json") {
            return Err(Refusal::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "send application/json"));
        }
        let length = only(headers, CONTENT_LENGTH)?.and_then(|length| length.parse::<u64>().ok()).unwrap_or_default();
        if length > MOST_BYTES as u64 { Err(too_large()) } else { Ok(()) }
    }

    /// Under which names this server is reached.
    fn names(&self) -> [String; 2] {
        ["127.0.0.1", "localhost"].map(|name| match self.port {
            // Browsers leave it out.
            80 => name.to_owned(),
            port => format!("{name}:{port}"),
        })
    }
}

pub fn too_large() -> Refusal {
    Refusal::new(StatusCode::PAYLOAD_TOO_LARGE, format!("an edit has at most {MOST_BYTES} bytes"))
}

/// The value of a header that must not come twice.
fn only(headers: &HeaderMap, name: impl AsHeaderName) -> Result<Option<&str>, Refusal> {
    let bad = || Refusal::new(StatusCode::BAD_REQUEST, "a header comes twice or cannot be read");
    let mut values = headers.get_all(name).iter();
    let Some(value) = values.next() else { return Ok(None) };
    if values.next().is_some() {
        return Err(bad());
    }
    value.to_str().map(Some).map_err(|_| bad())
}

/// Takes the same time for all texts of a length, so that nobody finds the token out byte by byte.
fn is_equal(one: &[u8], other: &[u8]) -> bool {
    let differing = one.iter().zip(other).fold(0, |differing, (a, b)| std::hint::black_box(differing | (a ^ b)));
    one.len() == other.len() && differing == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gate() -> Gate {
        Gate { port: 4711, token: "0123456789abcdef".into() }
    }

    const OWN: [(&str, &str); 4] = [
        ("host", "127.0.0.1:4711"),
        ("origin", "http://127.0.0.1:4711"),
        ("x-overfly-token", "0123456789abcdef"),
        ("content-type", "application/json"),
    ];

    /// What becomes of a request with the headers of the page, some of them replaced; an empty one is left out.
    fn judged(method: Method, uri: &str, changes: &[(&str, &str)]) -> Result<Route, u16> {
        let mut headers = HeaderMap::new();
        for (name, value) in OWN.iter().chain(changes) {
            let name: hyper::header::HeaderName = name.parse().unwrap();
            headers.remove(&name);
            if !value.is_empty() {
                headers.insert(name, value.parse().unwrap());
            }
        }
        gate().judge(&method, &uri.parse().unwrap(), &headers).map_err(|refusal| refusal.status.as_u16())
    }

    fn edit(changes: &[(&str, &str)]) -> Result<Route, u16> {
        judged(Method::POST, "/edits", changes)
    }

    #[test]
    fn the_page_itself_is_answered() {
        assert_eq!(judged(Method::GET, "/", &[("origin", ""), ("x-overfly-token", "")]), Ok(Route::Page));
        assert_eq!(judged(Method::GET, "/events", &[("x-overfly-token", "")]), Ok(Route::Events));
        assert_eq!(edit(&[]), Ok(Route::Edit));
        assert_eq!(edit(&[("origin", "")]), Ok(Route::Edit), "a program that names no origin");
        assert_eq!(edit(&[("host", "localhost:4711"), ("origin", "http://LOCALHOST:4711")]), Ok(Route::Edit));
        assert_eq!(
            edit(&[("content-type", "Application/JSON; charset=utf-8"), ("sec-fetch-site", "same-origin")]),
            Ok(Route::Edit)
        );
    }

    #[test]
    fn an_edit_needs_the_token() {
        for token in ["", "0", "0123456789abcdeF", "0123456789abcdef0", "0123456789abcde"] {
            assert_eq!(edit(&[("x-overfly-token", token)]), Err(403), "{token}");
        }
    }

    #[test]
    fn pages_of_other_origins_are_refused_whatever_they_know() {
        let others = [
            "null",
            "http://evil.example",
            "https://127.0.0.1:4711",
            "http://127.0.0.1",
            "http://127.0.0.1:4712",
            "http://localhost:4711",
            "http://127.0.0.1:4711.evil.example",
            "http://evil.example//127.0.0.1:4711",
        ];
        for origin in others {
            assert_eq!(edit(&[("origin", origin)]), Err(403), "{origin}");
            assert_eq!(judged(Method::GET, "/events", &[("origin", origin)]), Err(403), "{origin}");
        }
        for site in ["cross-site", "same-site", "unheard-of"] {
            assert_eq!(edit(&[("sec-fetch-site", site)]), Err(403), "{site}");
        }
        assert_eq!(judged(Method::GET, "/", &[("sec-fetch-site", "cross-site"), ("origin", "")]), Ok(Route::Page), "a link");
    }

    #[test]
    fn other_names_of_this_machine_are_refused() {
        for host in [
            "",
            "evil.example",
            "evil.example:4711",
            "127.0.0.1",
            "127.0.0.1:80",
            "127.0.0.1:4711.",
            "[::1]:4711",
            "0.0.0.0:4711",
        ] {
            for (method, path) in
                [(Method::GET, "/"), (Method::GET, "/events"), (Method::POST, "/edits"), (Method::GET, "/nothing")]
            {
                assert_eq!(judged(method, path, &[("host", host), ("origin", "")]), Err(403), "{host} {path}");
            }
        }
        assert_eq!(judged(Method::GET, "http://evil.example/", &[]), Err(403));
        assert_eq!(judged(Method::GET, "http://127.0.0.1:4711/", &[]), Ok(Route::Page));
        let mut twice = HeaderMap::new();
        twice.append("host", "127.0.0.1:4711".parse().unwrap());
        twice.append("host", "evil.example".parse().unwrap());
        let refused = gate().judge(&Method::GET, &"/".parse().unwrap(), &twice);
        assert_eq!(refused.unwrap_err().status, StatusCode::BAD_REQUEST);
        let default = Gate { port: 80, ..gate() };
        let headers = HeaderMap::from_iter([(HOST, "localhost".parse().unwrap())]);
        assert_eq!(default.judge(&Method::GET, &"/".parse().unwrap(), &headers), Ok(Route::Page));
    }

    #[test]
    fn other_methods_paths_kinds_and_sizes_are_refused_by_their_codes() {
        for method in [Method::GET, Method::PUT, Method::DELETE, Method::OPTIONS, Method::HEAD, Method::TRACE] {
            assert_eq!(judged(method.clone(), "/edits", &[]), Err(405), "{method}");
        }
        assert_eq!(judged(Method::POST, "/", &[]), Err(405));
        for path in ["/edit", "/edits/", "/../edits", "/favicon.ico", "//events"] {
            assert_eq!(judged(Method::GET, path, &[]), Err(404), "{path}");
        }
        for kind in ["", "text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=application/json"] {
            assert_eq!(edit(&[("content-type", kind)]), Err(415), "{kind}");
        }
        assert_eq!(edit(&[("content-length", "65536")]), Ok(Route::Edit));
        assert_eq!(edit(&[("content-length", "65537")]), Err(413));
    }
}
