//! A domain: one daemon and its clients, apart from all others.

use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::node::NodeView;
use iceoryx2::prelude::*;
use rustix::fs::{FlockOperation, flock};

use crate::service::Ipc;

/// Longest name of a domain, bytes: it becomes part of socket paths, which the system limits.
pub const MAX_NAME_BYTES: usize = 20;

/// Longest root of a domain, bytes. A socket's path of at most 107 bytes is the root, a slash, the prefix, an id of 39 digits and
/// a suffix of six.
const MAX_ROOT_BYTES: usize = 107 - 1 - PREFIX_BYTES - 39 - 6;
const PREFIX_BYTES: usize = 15;
const LOCK_FILE: &str = "daemon.lock";

/// Name and places of a domain. Making one touches nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Domain {
    name: String,
    root: PathBuf,
}

/// Why there is no such domain.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DomainError {
    #[error("the domain name {0:?} cannot be used; give 1 to {MAX_NAME_BYTES} of the characters a-z, 0-9 and -")]
    Name(String),
    #[error(
        "the path {root:?} is too long for the domain's sockets ({bytes} bytes, at most {MAX_ROOT_BYTES}); give a shorter domain name or set XDG_RUNTIME_DIR to a shorter directory"
    )]
    TooLong { root: PathBuf, bytes: usize },
    #[error("the path {0:?} holds characters that a domain's sockets cannot have; set XDG_RUNTIME_DIR to a plain one")]
    Path(PathBuf),
}

/// Why the domain's lock could not be had.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    #[error(
        "a daemon already serves the domain {domain:?} (process {pid}); use it, stop it with `overfly stop --domain {domain}`, or give another `--domain`"
    )]
    Held { domain: String, pid: String },
    #[error("the directory {path:?} of the domain belongs to somebody else; set XDG_RUNTIME_DIR to a directory of your own")]
    Foreign { path: PathBuf },
    #[error("{path:?}: {cause}; a domain needs a directory it can write to: set XDG_RUNTIME_DIR to one")]
    Io {
        path: PathBuf,
        #[source]
        cause: io::Error,
    },
    #[error(transparent)]
    Domain(#[from] DomainError),
}

/// The right to be the daemon of a domain, for as long as this lives.
#[derive(Debug)]
pub struct DomainLock {
    domain: Domain,
    file: File,
}

impl Domain {
    /// The domain called `name` of this user, in `$XDG_RUNTIME_DIR/overfly` or, without it, in `/tmp/overfly-UID`.
    pub fn new(name: &str) -> Result<Self, DomainError> {
        let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|path| path.is_absolute() && path.is_dir());
        let parent = match runtime {
            Some(runtime) => runtime.join("overfly"),
            None => PathBuf::from(format!("/tmp/overfly-{}", rustix::process::getuid().as_raw())),
        };
        Self::in_directory(name, &parent)
    }

    /// The domain called `name` whose files lie in a directory of that name under `parent`.
    pub fn in_directory(name: &str, parent: &Path) -> Result<Self, DomainError> {
        let plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
        if name.is_empty() || name.len() > MAX_NAME_BYTES || !name.bytes().all(plain) {
            return Err(DomainError::Name(name.chars().take(80).collect()));
        }
        let root = parent.join(name);
        let bytes = root.as_os_str().len();
        if bytes > MAX_ROOT_BYTES {
            return Err(DomainError::TooLong { root, bytes });
        }
        let domain = Self { name: name.into(), root };
        domain.config().map(|_| domain)
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// The directory that holds everything of the domain but its shared memory.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// What the names of all its shared-memory files start with. Domains with different roots have different prefixes.
    pub fn prefix(&self) -> String {
        format!("ofl_{:010x}_", fnv(self.root.as_os_str().as_encoded_bytes()) >> 24)
    }

    /// The configuration of iceoryx2 for this domain; no configuration file is looked up.
    pub fn config(&self) -> Result<Config, DomainError> {
        let unusable = || DomainError::Path(self.root.clone());
        let mut config = Config::default();
        let root = iceoryx2::prelude::Path::new(self.root.as_os_str().as_encoded_bytes()).map_err(|_| unusable())?;
        config.global.set_root_path(&root);
        config.global.prefix = FileName::new(self.prefix().as_bytes()).map_err(|_| unusable())?;
        config.defaults.publish_subscribe.subscriber_expired_connection_buffer = 128;
        Ok(config)
    }

    /// Takes the right to serve the domain. When nobody has served it and no client lives, what a killed daemon has left is swept.
    pub fn lock(&self) -> Result<DomainLock, LockError> {
        self.create_root()?;
        // A client that looks whether a daemon lives holds the lock for a moment.
        let patience = Instant::now() + Duration::from_millis(200);
        let file = loop {
            match self.try_lock(FlockOperation::NonBlockingLockExclusive)? {
                Attempt::Got(file) => break file,
                Attempt::Held(pid) if Instant::now() > patience => {
                    return Err(LockError::Held { domain: self.name.clone(), pid });
                }
                Attempt::Held(_) | Attempt::Gone => std::thread::sleep(Duration::from_millis(5)),
            }
        };
        let lock = DomainLock { domain: self.clone(), file };
        lock.close_to_clients();
        self.remove_segments();
        lock.sweep_if_deserted();
        lock.open_to_clients()?;
        Ok(lock)
    }

    /// Whether anything may be served here: a daemon holds the lock and is ready, or there is no lock file but somebody (a network tunnel) has
    /// made the domain's directory.
    pub fn seems_served(&self) -> bool {
        match fs::metadata(self.root.join(LOCK_FILE)) {
            // A lock file without a process id belongs to a daemon that is just starting or ending.
            Ok(lock_file) => lock_file.len() > 0 && self.is_locked(),
            Err(_) => self.root.join("services").is_dir(),
        }
    }

    /// Whether a daemon holds the domain's lock.
    pub fn is_locked(&self) -> bool {
        let Ok(file) = File::open(self.root.join(LOCK_FILE)) else { return false };
        // The lock is taken together with other readers and given back at once; a starting daemon waits for that.
        flock(&file, FlockOperation::NonBlockingLockShared) == Err(rustix::io::Errno::WOULDBLOCK)
    }

    /// The ids of the nodes that live in the domain on this machine; `None` when that cannot be told. Clients behind a network tunnel
    /// have none here.
    pub fn living_nodes(&self) -> Option<Vec<u128>> {
        let mut living = Vec::new();
        let listed = Node::<Ipc>::list(&self.config().ok()?, |state| {
            match &state {
                NodeState::Dead(_) => {}
                NodeState::Alive(view) => living.push(view.id().value()),
                NodeState::Inaccessible(id) | NodeState::Undefined(id) => living.push(id.value()),
            }
            CallbackProgression::Continue
        });
        listed.is_ok().then_some(living)
    }

    /// Removes what is left of the domain when neither a daemon nor a client lives in it. The last one to leave calls this.
    pub fn sweep_if_deserted(&self) {
        if !self.root.is_dir() {
            return;
        }
        if let Ok(Attempt::Got(file)) = self.try_lock(FlockOperation::NonBlockingLockExclusive) {
            DomainLock { domain: self.clone(), file }.release();
        }
    }

    /// The domain's files in shared memory.
    pub fn shared_memory_files(&self) -> Vec<PathBuf> {
        let prefix = self.prefix();
        let Ok(entries) = fs::read_dir("/dev/shm") else { return Vec::new() };
        let ours = |name: &std::ffi::OsStr| name.as_encoded_bytes().starts_with(prefix.as_bytes());
        entries.flatten().filter(|entry| ours(&entry.file_name())).map(|entry| entry.path()).collect()
    }

    fn create_root(&self) -> Result<(), LockError> {
        let io = |path: &Path| {
            let path = path.to_path_buf();
            move |cause| LockError::Io { path, cause }
        };
        DirBuilder::new().recursive(true).mode(0o700).create(&self.root).map_err(io(&self.root))?;
        let own = rustix::process::getuid().as_raw();
        for path in [self.root.parent().unwrap_or(&self.root), &self.root] {
            if fs::symlink_metadata(path).map_err(io(path))?.uid() != own {
                return Err(LockError::Foreign { path: path.to_path_buf() });
            }
        }
        Ok(())
    }

    fn try_lock(&self, operation: FlockOperation) -> Result<Attempt, LockError> {
        let path = self.root.join(LOCK_FILE);
        let io = |cause| LockError::Io { path: path.clone(), cause };
        let mut file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(0o600).open(&path).map_err(io)?;
        match flock(&file, operation) {
            Ok(()) => {}
            Err(rustix::io::Errno::WOULDBLOCK) => {
                let mut pid = String::new();
                let _ = file.read_to_string(&mut pid);
                let pid = if pid.is_empty() { "just starting or ending" } else { pid.trim() };
                return Ok(Attempt::Held(pid.to_owned()));
            }
            Err(cause) => return Err(io(cause.into())),
        }
        // Between opening and locking the file may have been removed by a daemon that ended: then this lock guards nothing.
        let locked = file.metadata().map_err(io)?;
        match fs::metadata(&path) {
            Ok(there) if there.ino() == locked.ino() && there.dev() == locked.dev() => Ok(Attempt::Got(file)),
            _ => Ok(Attempt::Gone),
        }
    }
}

/// The 64-bit FNV-1a hash of `bytes`.
pub(crate) fn fnv(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}

/// Whether nodes of this process count.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Own {
    Lives,
    IsLeaving,
}

enum Attempt {
    Got(File),
    /// Somebody else has it; the process id as far as it is known.
    Held(String),
    Gone,
}

impl DomainLock {
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// Gives the domain up. When no client lives in it any more, nothing of it stays behind, even if a thread of this process still
    /// uses something of it: this is the process's last act.
    pub fn release(self) {
        self.close_to_clients();
        self.domain.remove_segments();
        let deserted = self.is_deserted(Own::IsLeaving) && self.sweep();
        let _ = fs::remove_file(self.domain.root.join(LOCK_FILE));
        if deserted {
            // Fails when somebody has just made a new lock file in it, and then it must stay.
            let _ = fs::remove_dir(&self.domain.root);
        }
    }

    /// Removes what is left of the domain when no node lives.
    fn sweep_if_deserted(&self) {
        if self.is_deserted(Own::Lives) {
            self.sweep();
        }
    }

    /// Removes every file of the domain but the lock. A process that was killed while it created a service leaves
    /// a file on which every later attempt to open that service hangs; nothing but removing it helps.
    fn sweep(&self) -> bool {
        for entry in fs::read_dir(&self.domain.root).into_iter().flatten().flatten() {
            let path = entry.path();
            let is_dir = entry.file_type().is_ok_and(|kind| kind.is_dir());
            let _ = match entry.file_name() == LOCK_FILE {
                true => Ok(()),
                false if is_dir => fs::remove_dir_all(&path),
                false => fs::remove_file(&path),
            };
        }
        for path in self.domain.shared_memory_files() {
            let _ = fs::remove_file(path);
        }
        true
    }

    fn is_deserted(&self, own: Own) -> bool {
        let Ok(config) = self.domain.config() else { return false };
        let is_own = |id: &UniqueNodeId| id.pid::<Ipc>().is_ok_and(|pid| pid.value().cast_unsigned() == std::process::id());
        let mut lives = false;
        let listed = Node::<Ipc>::list(&config, |state| {
            // A node that cannot be judged counts as alive: its files stay.
            lives |= match &state {
                NodeState::Dead(_) => false,
                NodeState::Alive(view) => own == Own::Lives || !is_own(view.id()),
                NodeState::Inaccessible(id) | NodeState::Undefined(id) => own == Own::Lives || !is_own(id),
            };
            if lives { CallbackProgression::Stop } else { CallbackProgression::Continue }
        });
        listed.is_ok() && !lives
    }

    /// From now on clients may enter.
    fn open_to_clients(&self) -> Result<(), LockError> {
        let io = |cause| LockError::Io { path: self.domain.root.join(LOCK_FILE), cause };
        (&self.file).write_all(format!("{}\n", std::process::id()).as_bytes()).map_err(io)
    }

    /// An empty lock file tells clients to stay outside while the domain is swept.
    fn close_to_clients(&self) {
        // When this fails a client that enters just now finds its files gone, and tries again.
        let _ = self.file.set_len(0);
        let _ = (&self.file).rewind();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service;

    #[test]
    fn names_that_would_not_fit_a_path_are_refused() {
        for name in ["", "Upper", "a/b", "..", "a b", "a-name-of-more-than-twenty"] {
            assert!(matches!(Domain::new(name), Err(DomainError::Name(_))), "{name:?}");
        }
        let deep = PathBuf::from(format!("/{}", "d".repeat(100)));
        assert!(matches!(Domain::in_directory("a", &deep), Err(DomainError::TooLong { .. })));
    }

    #[test]
    fn domains_of_different_roots_share_no_prefix() {
        let a = Domain::in_directory("a", Path::new("/tmp/one")).unwrap();
        let b = Domain::in_directory("a", Path::new("/tmp/two")).unwrap();
        assert_ne!(a.prefix(), b.prefix());
        assert_eq!(a.prefix().len(), PREFIX_BYTES);
    }

    #[test]
    fn one_daemon_holds_a_domain_and_leaves_nothing() {
        let domain = Domain::new(&format!("lock-{}", std::process::id())).unwrap();
        assert!(!domain.seems_served());
        let lock = domain.lock().unwrap();
        assert!(domain.seems_served());
        let message = domain.lock().unwrap_err().to_string();
        assert!(message.contains(&std::process::id().to_string()) && message.contains(domain.name()), "{message}");
        lock.release();
        assert!(!domain.seems_served());
        assert!(!domain.root().exists());
        let again = domain.lock().unwrap();
        again.release();
    }

    #[test]
    fn a_thread_that_does_not_end_in_time_leaves_nothing_behind() {
        let domain = Domain::new(&format!("late-{}", std::process::id())).unwrap();
        let lock = domain.lock().unwrap();
        let node = service::node(&domain, "late").unwrap();
        let field = service::provide_field(&node, "town").unwrap();
        let publisher = service::publisher(&field, service::Memory::Fixed { blocks: 4, samples: 2 }).unwrap();
        assert!(!domain.shared_memory_files().is_empty());
        lock.release();
        assert_eq!(domain.shared_memory_files(), Vec::<PathBuf>::new());
        assert!(!domain.root().exists());
        // Neither must the end of the thread, should it come, bring anything back.
        drop((publisher, field, node));
        assert!(domain.shared_memory_files().is_empty() && !domain.root().exists());
    }

    #[test]
    fn leftovers_of_a_killed_process_are_swept_at_the_next_start() {
        let domain = Domain::new(&format!("left-{}", std::process::id())).unwrap();
        fs::create_dir_all(domain.root().join("services")).unwrap();
        let stuck = domain.root().join("services").join("half-made.service");
        let segment = Path::new("/dev/shm").join(format!("{}0.data", domain.prefix()));
        fs::write(&stuck, "").unwrap();
        fs::write(&segment, "").unwrap();
        let lock = domain.lock().unwrap();
        assert!(!stuck.exists() && !segment.exists());
        lock.release();
        assert!(!domain.root().exists());
    }
}
