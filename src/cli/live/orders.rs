//! The edits that a page asks for.

use hyper::StatusCode;
use overfly_client::EditOrder;
use serde::Deserialize;

use super::rules::Refusal;

/// What a page asks for, by the structure's name or its id in hexadecimal.
#[derive(Clone, Debug, PartialEq)]
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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Body {
    edit: Kind,
    structure: String,
    #[serde(default)]
    by_m: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Kind {
    Raise,
    Lower,
    Remove,
    Restore,
}

impl Order {
    /// Reads the body of a request. What the daemon judges itself, such as names and heights, is left to it.
    pub fn read(body: &[u8]) -> Result<Self, Refusal> {
        let bad = |reason: String| Refusal::new(StatusCode::BAD_REQUEST, reason);
        let example = r#"such as {"edit": "raise", "structure": "hall", "by_m": 15}"#;
        let read: Result<Body, _> = serde_json::from_slice(body);
        let Body { edit, structure, by_m } =
            read.map_err(|error| bad(format!("this is no edit ({error}); send one {example}")))?;
        match (edit, by_m) {
            (Kind::Raise, Some(by_m)) => Ok(Self::Raise { structure, by_m }),
            (Kind::Lower, Some(by_m)) => Ok(Self::Lower { structure, by_m }),
            (Kind::Remove, None) => Ok(Self::Remove { structure }),
            (Kind::Restore, None) => Ok(Self::Restore { structure }),
            (Kind::Raise | Kind::Lower, None) => Err(bad(format!("a change of height needs `by_m`, {example}"))),
            (Kind::Remove | Kind::Restore, Some(_)) => Err(bad("only changes of height have `by_m`".into())),
        }
    }

    /// The daemon's word for it; `None` for what only this server knows.
    pub fn plain(&self) -> Option<EditOrder> {
        match self.clone() {
            Self::Raise { structure, by_m } => Some(EditOrder::Raise { structure, by_m }),
            Self::Lower { structure, by_m } => Some(EditOrder::Lower { structure, by_m }),
            Self::Remove { structure } => Some(EditOrder::Remove { structure }),
            Self::Restore { .. } => None,
        }
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
            (r#" {"edit": "restore", "structure": "hall", "by_m": null} "#, Order::Restore { structure: structure() }),
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
