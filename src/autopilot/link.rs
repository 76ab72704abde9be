//! The way to an autopilot: a UDP socket, a TCP connection or a serial line, opened again when it breaks. No call waits longer than it is told to.

use std::fmt;
use std::fs::File;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs, UdpSocket};
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::str::FromStr;
use std::time::{Duration, Instant};

use mavlink::error::MessageReadError;
use mavlink::{MavHeader, MavlinkReader, write_v2_msg};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use super::{Address, MavMessage};

/// How long a TCP connection may take to come about, and something may take to be sent.
const CONNECT: Duration = Duration::from_secs(1);
/// A link that is broken is opened again so often.
const REOPEN: Duration = Duration::from_secs(1);
/// Whoever is heard first on a socket that listens is spoken to until it has been silent for so long.
const PEER_SILENCE: Duration = Duration::from_secs(5);
/// Largest datagram.
const DATAGRAM_BYTES: usize = 65_536;
/// One call reads no more than this of what is no message.
const MOST_BYTES: usize = 65_536;

/// Where an autopilot is to be reached.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// Speaks first, to this address.
    Udp(String),
    /// Listens at this address and answers whoever speaks.
    UdpIn(String),
    Tcp(String),
    Serial { device: String, baud: u32 },
}

/// Why a link cannot be named so.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{text:?} is no link: {what}; give udp:HOST:PORT (speak first), udpin:HOST:PORT (listen), tcp:HOST:PORT or serial:DEVICE:BAUD")]
pub struct PlaceError {
    text: String,
    what: &'static str,
}

/// Why a link is not there.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    #[error("the link {place} cannot be opened: {cause}; {}", remedy(.place))]
    Open { place: Place, cause: io::Error },
    #[error("the link {place} is broken: {cause}; it is opened again")]
    Broken { place: Place, cause: io::Error },
}

fn remedy(place: &Place) -> &'static str {
    match place {
        Place::Udp(_) => "see that the host is known and reached",
        Place::UdpIn(_) => "give an address of this machine and a port that no other program listens at",
        Place::Tcp(_) => "see that the autopilot or its router listens there",
        Place::Serial { .. } => "see that the device is there, that you may use it (group dialout), and that no other program does",
    }
}

impl FromStr for Place {
    type Err = PlaceError;

    fn from_str(text: &str) -> Result<Self, PlaceError> {
        let wrong = |what| PlaceError { text: text.to_owned(), what };
        let (kind, rest) = text.split_once(':').ok_or(wrong("it has no colon"))?;
        let host = || match rest.rsplit_once(':') {
            Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0) => Ok(rest.to_owned()),
            _ => Err(wrong("it lacks the host, or a port from 1 to 65535")),
        };
        match kind {
            "udp" | "udpout" => Ok(Self::Udp(host()?)),
            "udpin" => Ok(Self::UdpIn(host()?)),
            "tcp" => Ok(Self::Tcp(host()?)),
            "serial" => {
                let (device, baud) = rest.rsplit_once(':').ok_or(wrong("it lacks the baud rate"))?;
                let baud = baud.parse().ok().filter(|baud| (300..=12_000_000).contains(baud));
                let baud = baud.ok_or(wrong("its baud rate is no number from 300 to 12000000"))?;
                if device.is_empty() { Err(wrong("it lacks the device")) } else { Ok(Self::Serial { device: device.to_owned(), baud }) }
            }
            _ => Err(wrong("it begins with none of udp, udpin, tcp, serial")),
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udp(at) => write!(f, "udp:{at}"),
            Self::UdpIn(at) => write!(f, "udpin:{at}"),
            Self::Tcp(at) => write!(f, "tcp:{at}"),
            Self::Serial { device, baud } => write!(f, "serial:{device}:{baud}"),
        }
    }
}

/// A link that may be broken at the moment.
pub struct Link {
    place: Place,
    reader: Option<MavlinkReader<Source>>,
    sequence: u8,
    /// When it was last tried to open it.
    tried: Instant,
}

/// What bytes come from and go to.
struct Source {
    wire: Wire,
    /// The rest of a datagram.
    pending: Vec<u8>,
    taken: usize,
    /// What may yet be read in this call, and until when it may wait.
    budget: usize,
    until: Instant,
}

enum Wire {
    Udp { socket: UdpSocket, peer: Option<SocketAddr>, listens: bool, heard: Instant },
    Tcp(TcpStream),
    Serial(File),
}

impl Link {
    /// Opens the link; a place that is wrong or taken is found here.
    pub fn open(place: Place) -> Result<Self, LinkError> {
        let source = Source::open(&place).map_err(|cause| LinkError::Open { place: place.clone(), cause })?;
        Ok(Self { place, reader: Some(MavlinkReader::new(source)), sequence: 0, tried: Instant::now() })
    }

    /// The next message, of anybody, or `None` when none comes within `wait`. A link that is found broken is an error once; later calls open it again.
    pub fn receive(&mut self, wait: Duration) -> Result<Option<(Address, MavMessage)>, LinkError> {
        let until = Instant::now() + wait;
        let Some(reader) = self.opened(until) else { return Ok(None) };
        let source = reader.get_mut();
        (source.budget, source.until) = (MOST_BYTES, until);
        loop {
            match reader.read_any_message::<MavMessage>() {
                Ok((header, message)) => {
                    if let Ok(system) = u8::try_from(header.system_id) {
                        return Ok(Some((Address { system, component: header.component_id }, message)));
                    }
                }
                // A message of another dialect, or with a value that this one does not know.
                Err(MessageReadError::Parse(_)) => {}
                Err(MessageReadError::Io(cause)) if is_quiet(&cause) => return Ok(None),
                Err(MessageReadError::Io(cause)) => return Err(self.broken(cause)),
            }
            if reader.get_mut().budget == 0 {
                return Ok(None);
            }
        }
    }

    /// Sends a message; on a link that is broken it is lost, as on any other.
    pub fn send(&mut self, from: Address, message: &MavMessage) -> Result<(), LinkError> {
        let header = MavHeader { system_id: from.system.into(), component_id: from.component, sequence: self.sequence };
        self.sequence = self.sequence.wrapping_add(1);
        let mut bytes = Vec::with_capacity(64);
        // Writing to memory cannot fail.
        let _ = write_v2_msg(&mut bytes, header, message);
        let Some(reader) = &mut self.reader else { return Ok(()) };
        match reader.get_mut().send(&bytes) {
            Err(cause) if !is_quiet(&cause) => Err(self.broken(cause)),
            _ => Ok(()),
        }
    }

    fn opened(&mut self, until: Instant) -> Option<&mut MavlinkReader<Source>> {
        if self.reader.is_none() {
            if self.tried.elapsed() < REOPEN {
                std::thread::sleep(until.saturating_duration_since(Instant::now()));
                return None;
            }
            self.tried = Instant::now();
            self.reader = Source::open(&self.place).ok().map(MavlinkReader::new);
        }
        self.reader.as_mut()
    }

    fn broken(&mut self, cause: io::Error) -> LinkError {
        self.reader = None;
        LinkError::Broken { place: self.place.clone(), cause }
    }
}

/// Nothing there yet; or word that nobody listens at a UDP address, where somebody may later.
fn is_quiet(cause: &io::Error) -> bool {
    use io::ErrorKind::*;
    matches!(cause.kind(), WouldBlock | TimedOut | Interrupted | ConnectionRefused | NetworkUnreachable | HostUnreachable)
}

impl Source {
    fn open(place: &Place) -> io::Result<Self> {
        let resolve = |at: &str| at.to_socket_addrs()?.next().ok_or_else(|| io::Error::other("the name of the host is not known"));
        let wire = match place {
            Place::Udp(at) => {
                let peer = resolve(at)?;
                let any: SocketAddr = if peer.is_ipv4() { ([0, 0, 0, 0], 0).into() } else { ([0u16; 8], 0).into() };
                let socket = UdpSocket::bind(any)?;
                Wire::Udp { socket, peer: Some(peer), listens: false, heard: Instant::now() }
            }
            Place::UdpIn(at) => {
                Wire::Udp { socket: UdpSocket::bind(resolve(at)?)?, peer: None, listens: true, heard: Instant::now() }
            }
            Place::Tcp(at) => {
                let stream = TcpStream::connect_timeout(&resolve(at)?, CONNECT)?;
                stream.set_nodelay(true)?;
                stream.set_write_timeout(Some(CONNECT))?;
                Wire::Tcp(stream)
            }
            Place::Serial { device, baud } => Wire::Serial(serial(device, *baud)?),
        };
        Ok(Self { wire, pending: Vec::new(), taken: 0, budget: MOST_BYTES, until: Instant::now() })
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        match &mut self.wire {
            Wire::Udp { socket, peer, .. } => peer.map_or(Ok(()), |peer| socket.send_to(bytes, peer).map(drop)),
            Wire::Tcp(stream) => stream.write_all(bytes),
            Wire::Serial(file) => {
                let mut left = bytes;
                let end = Instant::now() + CONNECT;
                while !left.is_empty() {
                    wait_for(&*file, PollFlags::OUT, end)?;
                    match file.write(left) {
                        Ok(count) => left = &left[count..],
                        Err(cause) if cause.kind() == io::ErrorKind::WouldBlock && Instant::now() < end => {}
                        Err(cause) => return Err(cause),
                    }
                }
                Ok(())
            }
        }
    }

    /// Reads what is there, or waits for it.
    fn fetch(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = self.until.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
        match &mut self.wire {
            Wire::Udp { socket, peer, listens, heard } => {
                self.pending.resize(DATAGRAM_BYTES, 0);
                self.taken = 0;
                socket.set_read_timeout(Some(left))?;
                let received = socket.recv_from(&mut self.pending);
                let Ok((count, from)) = received else {
                    self.pending.clear();
                    return received.map(|_| 0);
                };
                let is_known = match peer {
                    Some(peer) if *peer == from => true,
                    // Somebody else may only take over from one that is silent.
                    Some(_) if !*listens || heard.elapsed() < PEER_SILENCE => false,
                    _ => {
                        *peer = Some(from);
                        true
                    }
                };
                if is_known {
                    *heard = Instant::now();
                }
                self.pending.truncate(if is_known { count } else { 0 });
                self.budget = self.budget.saturating_sub(count.max(1));
                // Nothing to read is not the end of anything.
                if self.pending.is_empty() { Err(io::ErrorKind::WouldBlock.into()) } else { self.rest(buffer) }
            }
            Wire::Tcp(stream) => {
                stream.set_read_timeout(Some(left))?;
                stream.read(buffer)
            }
            Wire::Serial(file) => {
                wait_for(&*file, PollFlags::IN, self.until)?;
                file.read(buffer)
            }
        }
    }

    fn rest(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = (self.pending.len() - self.taken).min(buffer.len());
        buffer[..count].copy_from_slice(&self.pending[self.taken..self.taken + count]);
        self.taken += count;
        Ok(count)
    }
}

impl Read for Source {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.taken < self.pending.len() {
            return self.rest(buffer);
        }
        if self.budget == 0 {
            return Err(io::ErrorKind::WouldBlock.into());
        }
        if matches!(self.wire, Wire::Udp { .. }) {
            return self.fetch(buffer);
        }
        let count = self.fetch(buffer)?;
        self.budget = self.budget.saturating_sub(count);
        Ok(count)
    }
}

/// A line without any processing of its own.
fn serial(device: &str, baud: u32) -> io::Result<File> {
    let flags = (OFlags::NONBLOCK | OFlags::NOCTTY).bits();
    let file = File::options().read(true).write(true).custom_flags(flags as i32).open(device)?;
    let mut settings = tcgetattr(&file)?;
    settings.make_raw();
    settings.set_speed(baud)?;
    tcsetattr(&file, OptionalActions::Now, &settings)?;
    Ok(file)
}

fn wait_for(file: impl AsFd, what: PollFlags, until: Instant) -> io::Result<()> {
    let left = until.saturating_duration_since(Instant::now());
    let limit = Timespec { tv_sec: left.as_secs() as i64, tv_nsec: i64::from(left.subsec_nanos()) };
    let mut one = [PollFd::new(&file, what)];
    if poll(&mut one, Some(&limit))? == 0 { Err(io::ErrorKind::TimedOut.into()) } else { Ok(()) }
}

#[cfg(test)]
mod tests;
