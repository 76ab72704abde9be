//! The program as a process, with a directory of its own for everything it leaves.
#![allow(dead_code, reason = "each test file uses its part")]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;
use tempfile::TempDir;

/// A place in which commands run: a working directory, and domains that nobody else sees.
pub struct Place {
    folder: TempDir,
}

/// A daemon that ends with this value.
pub struct Daemon {
    pub child: Child,
}

impl Place {
    pub fn new() -> Self {
        // Paths of sockets are short, so this stands directly under /tmp.
        Self { folder: tempfile::Builder::new().prefix("ofl").rand_bytes(5).tempdir_in("/tmp").unwrap() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a small scene of four buildings and returns its file name.
    pub fn scene(&self) -> String {
        let feature = |name: &str, x: f64, y: f64, height: f64| {
            let corner = |dx: f64, dy: f64| [4.47 + (x + dx) / 68_600.0, 51.91 + (y + dy) / 111_250.0];
            let ring = [corner(0.0, 0.0), corner(20.0, 0.0), corner(20.0, 15.0), corner(0.0, 15.0), corner(0.0, 0.0)];
            serde_json::json!({
                "type": "Feature",
                "id": name,
                "properties": { "height": height },
                "geometry": { "type": "Polygon", "coordinates": [ring] },
            })
        };
        let features = [
            feature("hall", 0.0, 0.0, 9.0),
            feature("tower", 40.0, 0.0, 24.0),
            feature("shed", 0.0, 35.0, 6.0),
            feature("inn", 40.0, 35.0, 12.0),
        ];
        let collection = serde_json::json!({ "type": "FeatureCollection", "features": features });
        std::fs::write(self.path("town.geojson"), collection.to_string()).unwrap();
        "town.geojson".to_owned()
    }

    pub fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_overfly"));
        command
            .args(words)
            .current_dir(self.folder.path())
            .env("XDG_RUNTIME_DIR", self.folder.path())
            .env_remove("RUST_LOG")
            .env_remove("OVERFLY_DOMAIN");
        command.stdin(Stdio::null());
        command
    }

    pub fn run(&self, words: &[&str]) -> Output {
        self.command(words).output().unwrap()
    }

    /// Runs a command that must succeed with `--json` and returns its object.
    pub fn json(&self, words: &[&str]) -> Value {
        let output = self.run(&[words, &["--json"]].concat());
        assert!(output.status.success(), "{words:?}: {}{}", stdout(&output), stderr(&output));
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{words:?}: {error}: {}", stdout(&output)))
    }

    /// Runs a command that must fail with `code`, once for people and once for scripts; returns the message, which must be the same.
    pub fn fails(&self, code: i32, kind: &str, words: &[&str]) -> String {
        let plain = self.run(words);
        assert_eq!(plain.status.code(), Some(code), "{words:?}: {}{}", stdout(&plain), stderr(&plain));
        assert!(plain.stdout.is_empty(), "{words:?}: {}", stdout(&plain));
        let scripted = self.run(&[words, &["--json"]].concat());
        assert_eq!(scripted.status.code(), Some(code), "{words:?}: {}", stderr(&scripted));
        let object: Value = serde_json::from_slice(&scripted.stdout).unwrap();
        assert_eq!(object["error"]["kind"], kind, "{object}");
        object["error"]["message"].as_str().unwrap().to_owned()
    }

    /// Starts a daemon in this place and waits until it answers.
    pub fn serve(&self, words: &[&str]) -> Daemon {
        let mut command = self.command(&[&["serve", "--until-stdin-ends"], words].concat());
        let child = command.stdin(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let domain: Vec<&str> = words.iter().copied().skip_while(|word| *word != "--domain").take(2).collect();
        let mut daemon = Daemon { child };
        while !self.run(&[&["status"], domain.as_slice()].concat()).status.success() {
            assert!(daemon.child.try_wait().unwrap().is_none(), "the daemon has ended");
        }
        daemon
    }

    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub fn files(&self, folder: &str) -> Vec<String> {
        list(&self.path(folder))
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        drop(self.child.stdin.take());
        let _ = self.child.wait();
    }
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn list(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{folder:?}: {error}"));
    let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}
