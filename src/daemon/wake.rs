//! File descriptors that wake the main loop: results of workers, and signals.

use std::io::{self, Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, Sender};

use iceoryx2::prelude::{FileDescriptor, FileDescriptorBased, SynchronousMultiplexing};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

/// A stream on which a byte means "look".
#[derive(Debug)]
pub struct WakeStream {
    // Does not own the descriptor and so must not outlive `stream`.
    descriptor: FileDescriptor,
    stream: UnixStream,
}

impl FileDescriptorBased for WakeStream {
    fn file_descriptor(&self) -> &FileDescriptor {
        &self.descriptor
    }
}

impl SynchronousMultiplexing for WakeStream {}

impl WakeStream {
    fn new(stream: UnixStream) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        let descriptor = FileDescriptor::non_owning_new(stream.as_raw_fd())
            .ok_or_else(|| io::Error::other("the descriptor of a fresh socket is not valid"))?;
        Ok(Self { descriptor, stream })
    }

    /// Takes all bytes; a wake-up that is not drained would make the loop spin.
    pub fn drain(&self) -> bool {
        let mut bytes = [0; 64];
        let mut woken = false;
        while let Ok(count @ 1..) = (&self.stream).read(&mut bytes) {
            woken = true;
            if count < bytes.len() {
                break;
            }
        }
        woken
    }
}

/// The sending end of [`mailbox`]; each worker has a clone.
#[derive(Debug)]
pub struct Mail<T> {
    sender: Sender<T>,
    wake: Arc<UnixStream>,
}

impl<T> Clone for Mail<T> {
    fn clone(&self) -> Self {
        Self { sender: self.sender.clone(), wake: self.wake.clone() }
    }
}

impl<T> Mail<T> {
    /// Sends `item` and wakes the loop. When the daemon has ended there is nobody to tell.
    pub fn post(&self, item: T) {
        if self.sender.send(item).is_ok() {
            // A full socket is as good as a byte: the loop is about to look.
            let _ = (&*self.wake).write(&[1]);
        }
    }
}

/// A channel whose receiver can be waited for together with iceoryx2's listeners.
pub fn mailbox<T>() -> io::Result<(Mail<T>, Receiver<T>, WakeStream)> {
    let (near, far) = UnixStream::pair()?;
    far.set_nonblocking(true)?;
    let (sender, receiver) = mpsc::channel();
    Ok((Mail { sender, wake: Arc::new(far) }, receiver, WakeStream::new(near)?))
}

/// The signals that the daemon obeys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// SIGTERM or SIGINT.
    End,
    /// SIGHUP.
    Reload,
}

/// Signals as wake-ups. The handlers only write a byte; they stay installed until this is dropped.
#[derive(Debug)]
pub struct Signals {
    pub end: WakeStream,
    pub reload: WakeStream,
    handlers: Vec<signal_hook::SigId>,
}

impl Signals {
    pub fn install() -> io::Result<Self> {
        let mut handlers = Vec::new();
        let (end, from_end) = UnixStream::pair()?;
        for signal in [SIGTERM, SIGINT] {
            handlers.push(signal_hook::low_level::pipe::register(signal, from_end.try_clone()?)?);
        }
        let (reload, from_reload) = UnixStream::pair()?;
        handlers.push(signal_hook::low_level::pipe::register(SIGHUP, from_reload)?);
        Ok(Self { end: WakeStream::new(end)?, reload: WakeStream::new(reload)?, handlers })
    }
}

impl Drop for Signals {
    fn drop(&mut self) {
        for handler in self.handlers.drain(..) {
            signal_hook::low_level::unregister(handler);
        }
    }
}
