//! The way to an autopilot: a UDP socket, a TCP connection or a serial line, opened again when it breaks. No call waits longer than it is told to.

use std::collections::VecDeque;
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
    Serial {
        device: String,
        baud: u32,
    },
}

/// Why a link cannot be named so.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{text:?} is no link: {what}; give udp:HOST:PORT (speak first), udpin:HOST:PORT (listen), tcp:HOST:PORT or serial:DEVICE:BAUD"
)]
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
        Place::Serial { .. } => {
            "see that the device is there, that you may use it (group dialout), and that no other program does"
        }
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
                if device.is_empty() {
                    Err(wrong("it lacks the device"))
                } else {
                    Ok(Self::Serial { device: device.to_owned(), baud })
                }
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
    wire: Option<Wire>,
    /// Messages of a datagram that wait.
    heard: VecDeque<(Address, MavMessage)>,
    sequence: u8,
    /// When it was last tried to open it.
    tried: Instant,
}

enum Wire {
    Datagrams(Datagrams),
    Stream(MavlinkReader<Source>),
}

struct Datagrams {
    socket: UdpSocket,
    peer: Option<SocketAddr>,
    listens: bool,
    heard: Instant,
    buffer: Vec<u8>,
}

/// A stream of bytes, of which one call may read so many, and wait until then.
struct Source {
    line: Line,
    budget: usize,
    until: Instant,
}

enum Line {
    Tcp(TcpStream),
    Serial(File),
}

impl Link {
    /// Opens the link; a place that is wrong or taken is found here.
    pub fn open(place: Place) -> Result<Self, LinkError> {
        let wire = Wire::open(&place).map_err(|cause| LinkError::Open { place: place.clone(), cause })?;
        Ok(Self { place, wire: Some(wire), heard: VecDeque::new(), sequence: 0, tried: Instant::now() })
    }

    /// The next message, of anybody, or `None` when none comes within `wait`. A link that is found broken is an error once; later calls open it again.
    pub fn receive(&mut self, wait: Duration) -> Result<Option<(Address, MavMessage)>, LinkError> {
        if self.heard.is_empty() {
            let until = Instant::now() + wait;
            let received = match self.opened(until) {
                Some(Wire::Datagrams(datagrams)) => datagrams.receive(until),
                Some(Wire::Stream(reader)) => receive_from(reader, until).map(|message| message.into_iter().collect()),
                None => return Ok(None),
            };
            match received {
                Ok(messages) => self.heard = messages,
                Err(cause) if is_quiet(&cause) => {}
                Err(cause) => return Err(self.broken(cause)),
            }
        }
        Ok(self.heard.pop_front())
    }

    /// Sends a message; on a link that is broken it is lost, as on any other.
    pub fn send(&mut self, from: Address, message: &MavMessage) -> Result<(), LinkError> {
        let header = MavHeader { system_id: from.system.into(), component_id: from.component, sequence: self.sequence };
        self.sequence = self.sequence.wrapping_add(1);
        let mut bytes = Vec::with_capacity(64);
        // Writing to memory cannot fail.
        let _ = write_v2_msg(&mut bytes, header, message);
        let sent = match &mut self.wire {
            Some(Wire::Datagrams(datagrams)) => datagrams.send(&bytes),
            Some(Wire::Stream(reader)) => reader.get_mut().send(&bytes),
            None => Ok(()),
        };
        match sent {
            Err(cause) if !is_quiet(&cause) => Err(self.broken(cause)),
            _ => Ok(()),
        }
    }

    fn opened(&mut self, until: Instant) -> Option<&mut Wire> {
        if self.wire.is_none() {
            if self.tried.elapsed() < REOPEN {
                std::thread::sleep(until.saturating_duration_since(Instant::now()));
                return None;
            }
            self.tried = Instant::now();
            self.wire = Wire::open(&self.place).ok();
        }
        self.wire.as_mut()
    }

    fn broken(&mut self, cause: io::Error) -> LinkError {
        self.wire = None;
        LinkError::Broken { place: self.place.clone(), cause }
    }
}

/// The next message of a stream.
fn receive_from(reader: &mut MavlinkReader<Source>, until: Instant) -> io::Result<Option<(Address, MavMessage)>> {
    (reader.get_mut().budget, reader.get_mut().until) = (MOST_BYTES, until);
    loop {
        match reader.read_any_message::<MavMessage>() {
            Ok((header, message)) => {
                if let Some(from) = address(&header) {
                    return Ok(Some((from, message)));
                }
            }
            // A message of another dialect, or with a value that this one does not know.
            Err(MessageReadError::Parse(_)) => {}
            Err(MessageReadError::Io(cause)) => return Err(cause),
        }
        if reader.get_mut().budget == 0 {
            return Ok(None);
        }
    }
}

/// Who sent a message; systems above 255 cannot be answered.
fn address(header: &MavHeader) -> Option<Address> {
    let system = u8::try_from(header.system_id).ok()?;
    Some(Address { system, component: header.component_id })
}

/// Nothing there yet; or word that nobody listens at a UDP address, where somebody may later.
fn is_quiet(cause: &io::Error) -> bool {
    use io::ErrorKind::*;
    matches!(cause.kind(), WouldBlock | TimedOut | Interrupted | ConnectionRefused | NetworkUnreachable | HostUnreachable)
}

impl Wire {
    fn open(place: &Place) -> io::Result<Self> {
        let resolve =
            |at: &str| at.to_socket_addrs()?.next().ok_or_else(|| io::Error::other("the name of the host is not known"));
        let line = match place {
            Place::Udp(at) => {
                let peer = resolve(at)?;
                let any: SocketAddr = if peer.is_ipv4() { ([0, 0, 0, 0], 0).into() } else { ([0u16; 8], 0).into() };
                return Ok(Self::Datagrams(Datagrams::new(UdpSocket::bind(any)?, Some(peer))));
            }
            Place::UdpIn(at) => return Ok(Self::Datagrams(Datagrams::new(UdpSocket::bind(resolve(at)?)?, None))),
            Place::Tcp(at) => {
                let stream = TcpStream::connect_timeout(&resolve(at)?, CONNECT)?;
                stream.set_nodelay(true)?;
                stream.set_write_timeout(Some(CONNECT))?;
                Line::Tcp(stream)
            }
            Place::Serial { device, baud } => Line::Serial(serial(device, *baud)?),
        };
        Ok(Self::Stream(MavlinkReader::new(Source { line, budget: MOST_BYTES, until: Instant::now() })))
    }
}

impl Datagrams {
    /// Speaks to a peer, or listens for one.
    fn new(socket: UdpSocket, peer: Option<SocketAddr>) -> Self {
        Self { socket, peer, listens: peer.is_none(), heard: Instant::now(), buffer: vec![0; DATAGRAM_BYTES] }
    }

    fn send(&self, bytes: &[u8]) -> io::Result<()> {
        self.peer.map_or(Ok(()), |peer| self.socket.send_to(bytes, peer).map(drop))
    }

    /// The messages of one datagram; what is no message in it does not touch the next one.
    fn receive(&mut self, until: Instant) -> io::Result<VecDeque<(Address, MavMessage)>> {
        let mut messages = VecDeque::new();
        self.socket.set_read_timeout(Some(least(until)))?;
        let (count, from) = self.socket.recv_from(&mut self.buffer)?;
        match self.peer {
            Some(peer) if peer == from => {}
            // Somebody else may only take over from one that is silent.
            Some(_) if !self.listens || self.heard.elapsed() < PEER_SILENCE => return Ok(messages),
            _ => self.peer = Some(from),
        }
        self.heard = Instant::now();
        let mut reader = MavlinkReader::new(&self.buffer[..count]);
        loop {
            match reader.read_any_message::<MavMessage>() {
                Ok((header, message)) => messages.extend(address(&header).map(|from| (from, message))),
                Err(MessageReadError::Parse(_)) => {}
                Err(MessageReadError::Io(_)) => return Ok(messages),
            }
        }
    }
}

impl Source {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        match &mut self.line {
            Line::Tcp(stream) => stream.write_all(bytes),
            Line::Serial(file) => {
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
}

impl Read for Source {
    /// Reads what is there, or waits for it.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.budget == 0 {
            return Err(io::ErrorKind::WouldBlock.into());
        }
        let count = match &mut self.line {
            Line::Tcp(stream) => {
                stream.set_read_timeout(Some(least(self.until)))?;
                stream.read(buffer)?
            }
            Line::Serial(file) => {
                wait_for(&*file, PollFlags::IN, self.until)?;
                file.read(buffer)?
            }
        };
        self.budget = self.budget.saturating_sub(count);
        Ok(count)
    }
}

/// What is left until then: more than nothing, which a socket would take for ever.
fn least(until: Instant) -> Duration {
    until.saturating_duration_since(Instant::now()).max(Duration::from_millis(1))
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
