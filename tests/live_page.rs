//! The page that `overfly watch --html` serves: what it sends, what it lets be changed and by whom, and what becomes of it when the daemon ends.

mod served;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use overfly_client::Client;
use serde_json::Value;
use served::{PATIENCE, Served, load, quick};

/// A server that ends with the test.
struct Page {
    child: Child,
    port: u16,
    token: String,
}

impl Page {
    fn open(served: &Served, scene: &str) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_overfly"));
        command.args(["watch", scene, "--html", "0", "--json", "--domain", served.domain.name()]).env_remove("RUST_LOG");
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let said: Value = serde_json::from_str(&line).unwrap();
        let port = u16::try_from(said["port"].as_u64().unwrap()).unwrap();
        assert_eq!(said["address"], format!("http://127.0.0.1:{port}/"));
        let mut page = Self { child, port, token: String::new() };
        page.token = token(&page.get("/").body);
        page
    }

    fn host(&self) -> String {
        format!("127.0.0.1:{}", self.port)
    }

    /// Sends these bytes, and hears what comes back until the server closes.
    fn say(&self, request: &[u8]) -> Heard {
        let mut stream = self.connect();
        // The server may refuse, and close, before it has heard everything.
        let _ = stream.write_all(request);
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        Heard::read(&String::from_utf8_lossy(&bytes))
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.host()).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    fn get(&self, path: &str) -> Heard {
        self.say(format!("GET {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", self.host()).as_bytes())
    }

    /// Posts an edit with the headers of the page, and others instead or besides.
    fn edit_with(&self, body: &str, changes: &[(&str, &str)]) -> Heard {
        let (host, origin) = (self.host(), format!("http://{}", self.host()));
        let length = body.len().to_string();
        let own = [
            ("Host", host.as_str()),
            ("Origin", &origin),
            ("X-Overfly-Token", &self.token),
            ("Content-Type", "application/json"),
            ("Content-Length", &length),
            ("Connection", "close"),
        ];
        let is_changed = |name: &str| changes.iter().any(|(changed, _)| changed.eq_ignore_ascii_case(name));
        let headers: String = own
            .iter()
            .filter(|(name, _)| !is_changed(name))
            .chain(changes.iter().filter(|(_, value)| !value.is_empty()))
            .map(|(name, value)| format!("{name}: {value}\r\n"))
            .collect();
        self.say(format!("POST /edits HTTP/1.1\r\n{headers}\r\n{body}").as_bytes())
    }

    fn edit(&self, body: &str) -> Heard {
        self.edit_with(body, &[])
    }

    fn events(&self) -> Events {
        let mut stream = self.connect();
        write!(stream, "GET /events HTTP/1.1\r\nHost: {}\r\n\r\n", self.host()).unwrap();
        Events { lines: BufReader::new(stream), event: String::new() }
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The token that the page knows.
fn token(page: &str) -> String {
    let (_, settings) = page.split_once("id=\"live-settings\" type=\"application/json\">").expect("the page has settings");
    let settings: Value = serde_json::from_str(settings.split('<').next().unwrap()).unwrap();
    settings["token"].as_str().unwrap().to_owned()
}

/// A reply.
struct Heard {
    status: u16,
    head: String,
    body: String,
}

impl Heard {
    fn read(text: &str) -> Self {
        let (head, body) = text.split_once("\r\n\r\n").unwrap_or((text, ""));
        let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or_default();
        Self { status, head: head.to_lowercase(), body: body.to_owned() }
    }

    fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error}: {} {}", self.head, self.body))
    }

    fn error(&self) -> String {
        self.json()["error"].as_str().expect("an error says why").to_owned()
    }
}

/// A stream of events.
struct Events {
    lines: BufReader<TcpStream>,
    event: String,
}

impl Events {
    /// The next event of a kind that is as wanted; others are passed over.
    fn wait(&mut self, kind: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let started = Instant::now();
        loop {
            assert!(started.elapsed() < PATIENCE, "no {kind} came that is wanted");
            let mut line = String::new();
            assert!(self.lines.read_line(&mut line).unwrap() > 0, "the stream ended before the {kind} that is wanted");
            if let Some(event) = line.strip_prefix("event: ") {
                self.event = event.trim().to_owned();
            }
            if let Some(data) = line.strip_prefix("data: ").filter(|_| self.event == kind) {
                let data: Value = serde_json::from_str(data).unwrap();
                if wanted(&data) {
                    return data;
                }
            }
        }
    }

    fn shown(&mut self, revision: u64) -> Value {
        self.wait("show", |shown| shown["revision"] == revision)
    }

    fn phase(&mut self, phase: &str) -> Value {
        self.wait("status", |status| status["phase"] == phase)
    }
}

/// A daemon with a planned block, its client and the name of its tallest building.
fn planned() -> (Served, Client, String) {
    let served = Served::start();
    let client = served.client();
    load(&client, "block");
    client.plan("block", &quick(), &mut |_| {}).unwrap();
    let structures = client.structures("block").unwrap();
    let tallest = structures.into_iter().max_by(|a, b| a.top_m.total_cmp(&b.top_m)).unwrap().name;
    (served, client, tallest)
}

fn revision(client: &Client) -> u64 {
    client.status().unwrap().scenes[0].revision
}

#[test]
fn the_page_shows_the_plan_and_each_one_that_follows_from_its_edits() {
    let (served, client, tallest) = planned();
    let page = Page::open(&served, "block");
    let whole = page.get("/");
    assert_eq!(whole.status, 200);
    for guard in [
        "content-type: text/html; charset=utf-8",
        "content-security-policy: default-src 'none'",
        "x-content-type-options: nosniff",
        "cache-control: no-store",
        "x-frame-options: deny",
    ] {
        assert!(whole.head.contains(guard), "{guard} is not in {}", whole.head);
    }
    assert!(!whole.head.contains("access-control"), "{}", whole.head);

    let (mut one, mut other) = (page.events(), page.events());
    let first = one.shown(1);
    assert!(first["epoch"].as_u64().unwrap() > 0 && first["infeasible"].is_null(), "{first:.200}");
    assert_eq!(other.shown(1), first, "a late page gets the newest state");

    let made = page.edit(&format!(r#"{{"edit": "raise", "structure": "{tallest}", "by_m": 15}}"#));
    assert_eq!(made.status, 200, "{}", made.body);
    assert_eq!((made.json()["revision"].as_u64(), made.json()["replan_follows"].as_bool()), (Some(2), Some(true)));
    let (seen, also) = (one.shown(2), other.shown(2));
    assert!(seen["epoch"].as_u64() > first["epoch"].as_u64() && also["epoch"].as_u64() > first["epoch"].as_u64());
    // Somebody else's edits come to the page as well.
    client.edit("block", &overfly_client::EditOrder::Lower { structure: tallest, by_m: 5.0 }).unwrap();
    one.shown(3);
    other.shown(3);
}

#[test]
fn what_is_not_from_the_page_changes_nothing() {
    let (served, client, tallest) = planned();
    let page = Page::open(&served, "block");
    let body = format!(r#"{{"edit": "raise", "structure": "{tallest}", "by_m": 15}}"#);
    let wrong = "0".repeat(page.token.len());
    let other_port = format!("http://127.0.0.1:{}", page.port ^ 1);
    for (name, value) in [
        ("X-Overfly-Token", ""),
        ("X-Overfly-Token", &wrong),
        ("Origin", "http://evil.example"),
        ("Origin", "null"),
        ("Origin", &other_port),
        ("Host", "evil.example"),
        ("Sec-Fetch-Site", "cross-site"),
    ] {
        let refused = page.edit_with(&body, &[(name, value)]);
        assert_eq!(refused.status, 403, "{name}: {value}: {}", refused.body);
        assert!(!refused.error().is_empty());
    }
    let large = format!("{body}{}", " ".repeat(70_000));
    assert_eq!(page.edit(&large).status, 413);
    let chunks = format!("{:x}\r\n{large}\r\n0\r\n\r\n", large.len());
    assert_eq!(page.edit_with(&chunks, &[("Content-Length", ""), ("Transfer-Encoding", "chunked")]).status, 413);
    assert_eq!(page.edit_with(&body, &[("Content-Type", "text/plain")]).status, 415);
    assert_eq!(page.edit("{\"edit\": \"raise\"").status, 400);
    assert_eq!(page.edit(&"[".repeat(60_000)).status, 400);
    assert_eq!(page.say(b"\x16\x03\x01\x02\x00\x01\x00\xff\xfe\r\n\r\n").status, 400);
    assert_eq!(page.say(b"GET /events HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n").status, 403);
    assert_eq!(page.get("/etc/passwd").status, 404);
    assert_eq!(revision(&client), 1, "nothing of that was an edit");
    // What the daemon refuses comes with its reason.
    let refused = page.edit(r#"{"edit": "lower", "structure": "nowhere", "by_m": 1}"#);
    assert!(refused.status == 404 && refused.error().contains("nowhere"), "{} {}", refused.status, refused.body);
    let refused = page.edit(&format!(r#"{{"edit": "raise", "structure": "{tallest}", "by_m": -1}}"#));
    assert!(refused.status == 400 && refused.error().contains("above 0"), "{} {}", refused.status, refused.body);
    assert_eq!(revision(&client), 1);
    assert_eq!(page.edit(&body).status, 200, "and the page still can");
    assert_eq!(revision(&client), 2);
}

#[test]
fn a_removed_building_can_be_put_back_as_it_was() {
    let (served, client, tallest) = planned();
    let page = Page::open(&served, "block");
    let mut events = page.events();
    let before = client.structures("block").unwrap();
    let id = format!("{:016x}", before.iter().find(|structure| structure.name == tallest).unwrap().id);
    let refused = page.edit(&format!(r#"{{"edit": "restore", "structure": "{id}"}}"#));
    assert_eq!(refused.status, 404, "{}", refused.body);
    let removed = page.edit(&format!(r#"{{"edit": "remove", "structure": "{tallest}"}}"#));
    assert_eq!((removed.status, removed.json()["can_be_restored"].as_bool()), (200, Some(true)), "{}", removed.body);
    let status = events.wait("status", |status| status["removed"].as_array().is_some_and(|removed| !removed.is_empty()));
    assert_eq!((&status["removed"][0]["id"], &status["removed"][0]["name"]), (&id.clone().into(), &tallest.into()));
    assert_eq!(client.structures("block").unwrap().len() + 1, before.len());
    let restored = page.edit(&format!(r#"{{"edit": "restore", "structure": "{id}"}}"#));
    assert_eq!(restored.status, 200, "{}", restored.body);
    assert_eq!(client.structures("block").unwrap(), before);
    events.wait("status", |status| status["removed"].as_array().is_some_and(Vec::is_empty));
    events.shown(3);
}

#[test]
fn a_scene_that_is_loaded_anew_takes_the_place_of_the_one_before() {
    let served = Served::start();
    let client = served.client();
    let load = |seed| client.load(served::block(seed, 9), Some("block"), &mut |_| {}).unwrap();
    load(1);
    let page = Page::open(&served, "block");
    let mut events = page.events();
    let of_first = events.shown(1)["page"]["scenes"].clone();
    // Both have the first revision, and neither a plan.
    load(2);
    let of_second = events.wait("show", |shown| shown["page"]["scenes"] != of_first);
    assert_eq!(of_second["revision"], 1, "{of_second:.200}");
    let id = format!("{:016x}", client.structures("block").unwrap()[0].id);
    assert_eq!(page.edit(&format!(r#"{{"edit": "remove", "structure": "{id}"}}"#)).status, 200);
    let removed = |status: &Value| status["removed"].as_array().map_or(0, Vec::len);
    events.wait("status", |status| status["revision"] == 2 && removed(status) == 1);
    load(3);
    events.wait("status", |status| status["revision"] == 1 && removed(status) == 0);
    let refused = page.edit(&format!(r#"{{"edit": "restore", "structure": "{id}"}}"#));
    assert_eq!(refused.status, 404, "{}", refused.body);
}

#[test]
fn a_plan_in_the_same_scene_is_sent_once() {
    let (served, client, _) = planned();
    let page = Page::open(&served, "block");
    let mut events = page.events();
    let has_coverage = |shown: &Value| !shown["page"]["flights"][0]["coverage"].is_null();
    let first = events.wait("show", |shown| has_coverage(shown) && shown["is_interim"] == false)["epoch"].clone();
    client.plan("block", &quick(), &mut |_| {}).unwrap();
    let next = events.wait("show", |shown| shown["epoch"].as_u64() > first.as_u64());
    assert!(has_coverage(&next), "what it captures is known as soon as its path: {next:.200}");
}

#[test]
fn a_lost_daemon_is_told_and_found_again() {
    let (mut served, client, tallest) = planned();
    drop(client);
    let page = Page::open(&served, "block");
    let mut events = page.events();
    events.shown(1);
    let body = format!(r#"{{"edit": "raise", "structure": "{tallest}", "by_m": 15}}"#);
    assert_eq!(page.edit(&body).status, 200);
    events.shown(2);
    served.signal("-KILL");
    let lost = events.phase("lost");
    assert!(lost["remark"].as_str().is_some_and(|remark| remark.contains("daemon")), "{lost}");
    let refused = page.edit(&body);
    assert!(refused.status == 503 && refused.error().contains("daemon"), "{} {}", refused.status, refused.body);

    served.restart();
    let unloaded = events.phase("unloaded");
    assert!(unloaded["remark"].as_str().is_some_and(|remark| remark.contains("block")), "{unloaded}");
    let client = served.client();
    load(&client, "block");
    let alone = events.shown(1);
    assert!(alone["epoch"].is_null(), "the scene without a plan: {alone:.200}");
    events.phase("idle");
    client.plan("block", &quick(), &mut |_| {}).unwrap();
    events.wait("show", |shown| shown["epoch"].is_u64());
    let made = page.edit(&body);
    assert_eq!(made.status, 200, "{}", made.body);
    assert_eq!(made.json()["revision"], 2);
    events.shown(2);
}

#[test]
fn pages_that_do_not_read_hold_nobody_up() {
    let (served, _client, tallest) = planned();
    let page = Page::open(&served, "block");
    let mut idle: Vec<Events> = (0..20).map(|_| page.events()).collect();
    // One that breaks off within a request, and one that never sends any.
    page.connect().write_all(b"POST /edits HTTP/1.1\r\nHost:").unwrap();
    let _silent = page.connect();
    let mut reader = page.events();
    reader.shown(1);
    for revision in 2..6 {
        let made = page.edit(&format!(r#"{{"edit": "raise", "structure": "{tallest}", "by_m": 1}}"#));
        assert_eq!(made.status, 200, "{}", made.body);
        reader.wait("show", |shown| shown["revision"].as_u64() >= Some(revision));
    }
    idle.truncate(3);
    idle.iter_mut().for_each(|late| drop(late.wait("show", |shown| shown["revision"].as_u64() >= Some(5))));
}
