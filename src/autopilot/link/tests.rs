use std::net::TcpListener;
use std::os::fd::OwnedFd;

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use super::*;
use crate::autopilot::dialect::MISSION_CURRENT_DATA;

const AIRCRAFT: Address = Address { system: 7, component: 1 };
const WAIT: Duration = Duration::from_secs(5);

fn current(seq: u16) -> MavMessage {
    MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA { seq, ..MISSION_CURRENT_DATA::DEFAULT })
}

fn bytes(seq: u16) -> Vec<u8> {
    let mut bytes = Vec::new();
    let header = MavHeader { system_id: 7, component_id: 1, sequence: 0 };
    write_v2_msg(&mut bytes, header, &current(seq)).unwrap();
    bytes
}

/// Listens at a port that is free.
fn listening() -> (Link, SocketAddr) {
    let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    (Link::open(Place::UdpIn(free.to_string())).unwrap(), free)
}

#[test]
fn links_are_named_in_four_ways_and_what_is_wrong_is_said() {
    for text in ["udp:10.0.0.2:14550", "udpin:0.0.0.0:14540", "tcp:localhost:5760", "serial:/dev/ttyACM0:57600"] {
        assert_eq!(text.parse::<Place>().unwrap().to_string(), text);
    }
    assert_eq!("udp:[::1]:14550".parse::<Place>().unwrap(), Place::Udp("[::1]:14550".to_owned()));
    let wrong = [
        "",
        "udp",
        "udp:",
        "udp:14550",
        "udp::14550",
        "udpin:host:0",
        "tcp:h:99999",
        "http:h:80",
        "serial:/dev/tty",
        "serial::9600",
    ];
    for text in wrong {
        let error = text.parse::<Place>().unwrap_err().to_string();
        assert!(error.contains("udpin:HOST:PORT"), "{error}");
    }
}

#[test]
fn a_listener_answers_whoever_spoke_first_and_nobody_else() {
    let (mut link, at) = listening();
    let [aircraft, stranger] = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
    link.send(AIRCRAFT, &current(1)).unwrap();
    aircraft.send_to(&bytes(3), at).unwrap();
    assert_eq!(link.receive(WAIT).unwrap(), Some((AIRCRAFT, current(3))));
    stranger.send_to(&bytes(4), at).unwrap();
    assert_eq!(link.receive(Duration::from_millis(50)).unwrap(), None);
    link.send(AIRCRAFT, &current(5)).unwrap();
    aircraft.set_read_timeout(Some(WAIT)).unwrap();
    let mut buffer = [0; 300];
    let count = aircraft.recv(&mut buffer).unwrap();
    assert!(count > 12 && buffer[0] == 0xfd);
    stranger.set_nonblocking(true).unwrap();
    assert!(stranger.recv(&mut buffer).is_err());
}

#[test]
fn several_messages_in_a_datagram_and_garbage_between_are_no_trouble() {
    let (mut link, at) = listening();
    let aircraft = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut datagram = bytes(1);
    datagram.extend([0xfd, 0x00, 0x17, 0xfe, 0x55]);
    datagram.extend(bytes(2));
    datagram.extend(vec![0xfd; 400]);
    datagram.extend(bytes(3));
    aircraft.send_to(&datagram, at).unwrap();
    aircraft.send_to(&[], at).unwrap();
    aircraft.send_to(&bytes(4), at).unwrap();
    let mut heard = Vec::new();
    let started = Instant::now();
    while heard.last() != Some(&4) && started.elapsed() < WAIT {
        if let Some((_, MavMessage::MISSION_CURRENT(current))) = link.receive(Duration::from_millis(20)).unwrap() {
            heard.push(current.seq);
        }
    }
    assert!(heard.starts_with(&[1]) && heard.ends_with(&[4]), "{heard:?}");
}

#[test]
fn a_flood_of_garbage_does_not_hold_a_call() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap();
    let flood = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        while stream.write_all(&[0x11; 4096]).is_ok() {}
    });
    let mut link = Link::open(Place::Tcp(at.to_string())).unwrap();
    let started = Instant::now();
    for _ in 0..20 {
        assert_eq!(link.receive(Duration::from_millis(20)).unwrap(), None);
    }
    assert!(started.elapsed() < Duration::from_secs(10), "{:?}", started.elapsed());
    drop(link);
    flood.join().unwrap();
}

#[test]
fn a_connection_that_breaks_is_told_once_and_opened_again() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap();
    let mut link = Link::open(Place::Tcp(at.to_string())).unwrap();
    drop(listener.accept().unwrap());
    let broken = (0..10).find_map(|_| link.receive(Duration::from_millis(50)).err());
    assert!(matches!(broken, Some(LinkError::Broken { .. })), "{broken:?}");
    assert_eq!(link.receive(Duration::from_millis(1)).unwrap(), None);
    let server = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(&bytes(9)).unwrap();
        stream
    });
    let started = Instant::now();
    let heard = loop {
        if let Ok(Some(heard)) = link.receive(Duration::from_millis(20)) {
            break heard;
        }
        assert!(started.elapsed() < WAIT, "it is not opened again");
    };
    assert_eq!(heard, (AIRCRAFT, current(9)));
    drop(server.join().unwrap());
}

#[test]
fn a_place_where_nothing_is_says_so() {
    for place in [Place::Serial { device: "/dev/nothing-there".to_owned(), baud: 57_600 }, Place::Tcp("127.0.0.1:1".to_owned())] {
        let error = Link::open(place).err().expect("nothing is there").to_string();
        assert!(error.contains("cannot be opened") && error.contains("; see that"), "{error}");
    }
}

#[test]
fn a_serial_line_carries_messages_both_ways() {
    let master: OwnedFd = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let device = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    let mut link = Link::open(Place::Serial { device, baud: 57_600 }).unwrap();
    let mut other_end = File::from(master);
    // Carriage returns and line feeds go through as they are.
    for seq in [0x0d0a, 0x1103, 0x7f04] {
        other_end.write_all(&bytes(seq)).unwrap();
        assert_eq!(link.receive(WAIT).unwrap(), Some((AIRCRAFT, current(seq))));
    }
    let started = Instant::now();
    assert_eq!(link.receive(Duration::from_millis(30)).unwrap(), None);
    assert!(started.elapsed() >= Duration::from_millis(25));
    link.send(AIRCRAFT, &current(0x0a0d)).unwrap();
    let mut heard = vec![0; bytes(0x0a0d).len()];
    other_end.read_exact(&mut heard).unwrap();
    assert_eq!(heard, bytes(0x0a0d));
}
