//! The edits that a page asks for.

use hyper::StatusCode;
use serde::Deserialize;

use super::rules::Refusal;

/// What a page asks for, by the structure's name or its id in hexadecimal.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "edit", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Order {
    Raise {
        structure: String,
        by_m: f64,
    },
    Lower {
        structure: String,
        by_m: f64,
    },
    Remove {
        structure: String,
    },
    /// Puts back what was removed from here.
    Restore {
        structure: String,
    },
}

impl Order {
    /// Reads the body of a request. What the daemon judges itself, such as names and heights, is left to it.
    pub fn read(body: &[u8]) -> Result<Self, Refusal> {
        serde_json::from_slice(body).map_err(|error| {
            let example = r#"such as {"edit": "raise", "structure": "hall", "by_m": 15}"#;
            Refusal::new(StatusCode::BAD_REQUEST, format!("this is no edit ({error}); send one {example}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_edit_is_read_as_it_is_written() {
        let structure = || "hall".to_owned();
        for (body, order) in [
            (r#"{"edit": "raise", "structure": "hall", "by_m": 15}"#, Order::Raise { structure: structure(), by_m: 15.0 }),
            (r#"{"by_m": 2.5, "edit": "lower", "structure": "hall"}"#, Order::Lower { structure: structure(), by_m: 2.5 }),
            (r#"{"edit": "remove", "structure": "hall"}"#, Order::Remove { structure: structure() }),
            (r#" {"edit": "restore", "structure": "hall"} "#, Order::Restore { structure: structure() }),
        ] {
            assert_eq!(Order::read(body.as_bytes()), Ok(order), "{body}");
        }
    }

    #[test]
    fn everything_else_is_refused_and_says_how_an_edit_looks() {
        let deep = format!("{{\"edit\": {}1{}}}", "[".repeat(60_000), "]".repeat(5));
        for body in [
            "",
            "null",
            "[]",
            "{}",
            "{\"edit\": \"raise\"",
            r#"{"edit": "burn", "structure": "hall"}"#,
            r#"{"edit": "raise", "structure": 7, "by_m": 1}"#,
            r#"{"edit": "raise", "structure": "hall", "by_m": "1"}"#,
            r#"{"edit": "raise", "structure": "hall", "by_m": 1e999}"#,
            r#"{"edit": "raise", "structure": "hall", "by_m": NaN}"#,
            r#"{"edit": "raise", "structure": "hall", "by_m": 1, "by_m": 2}"#,
            r#"{"edit": "raise", "structure": "hall", "by_m": 1, "scene": "other"}"#,
            r#"{"edit": "raise", "structure": "hall"}"#,
            r#"{"edit": "remove", "structure": "hall", "by_m": 1}"#,
            r#"{"edit": "remove", "structure": "hall"} {}"#,
            "\u{feff}{}",
            &deep,
        ] {
            let refusal = Order::read(body.as_bytes()).unwrap_err();
            assert_eq!(refusal.status, StatusCode::BAD_REQUEST, "{body:.80}");
            assert!(refusal.reason.len() < 300, "{}", refusal.reason);
        }
        assert_eq!(Order::read(&[0xff, 0xfe, b'{']).unwrap_err().status, StatusCode::BAD_REQUEST);
    }
}
