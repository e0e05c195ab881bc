//! Brokers that do not accept the protocol version or the options that are tried first.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc::{self, Receiver};
use std::thread;
use std::time::{Duration, Instant};

use swarmwright_mqtt::{ConnectError, Connection, QoS, Settings, Subscription, Version, Will};

/// Reaction of a listener to a connection, given its CONNECT.
enum Answer {
    /// No answer until the client has left.
    Silence,
    /// A CONNACK of MQTT 5 with this reason code, then the end of the connection.
    Refuse(u8),
    /// A successful CONNACK, then the end of the connection.
    Break,
    /// All required answers.
    Serve,
}

/// A received CONNECT: protocol level and flags.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Connect {
    level: u8,
    flags: u8,
}

impl Connect {
    fn will_qos(self) -> u8 {
        self.flags >> 3 & 3
    }
}

/// Creates a listener that answers with `answer`, and reports what it received.
fn listen(
    answer: impl Fn(usize, Connect) -> Answer + Send + 'static,
) -> (String, Receiver<Connect>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("mqtt://{}", listener.local_addr().unwrap());
    let (tell, receiver) = mpsc::channel();
    thread::spawn(move || {
        for (number, socket) in listener.incoming().enumerate() {
            let mut socket = socket.unwrap();
            let mut buffer = [0; 1000];
            let count = socket.read(&mut buffer).unwrap();
            assert!(count > 9 && buffer[0] == 0x10, "{buffer:?}");
            // Fixed header (one or two bytes of length), the name "MQTT" with its length, then level and flags.
            let start = if buffer[1] & 0x80 == 0 { 2 } else { 3 };
            let connect = Connect {
                level: buffer[start + 6],
                flags: buffer[start + 7],
            };
            if tell.send(connect).is_err() {
                return;
            }
            serve(&mut socket, &answer(number, connect), connect.level);
        }
    });
    (url, receiver)
}

fn serve(socket: &mut TcpStream, answer: &Answer, level: u8) {
    let mut buffer = [0; 1000];
    let code = match answer {
        Answer::Silence => {
            let _ = socket.read(&mut buffer);
            return;
        }
        Answer::Refuse(code) => *code,
        Answer::Break | Answer::Serve => 0,
    };
    let connack: &[u8] = if level == 5 {
        &[0x20, 3, 0, code, 0]
    } else {
        &[0x20, 2, 0, code]
    };
    socket.write_all(connack).unwrap();
    if !matches!(answer, Answer::Serve) {
        return;
    }
    let _ = socket.read(&mut buffer).unwrap();
    let suback: &[u8] = if level == 5 {
        &[0x90, 4, buffer[2], buffer[3], 0, 0]
    } else {
        &[0x90, 3, buffer[2], buffer[3], 0]
    };
    socket.write_all(suback).unwrap();
    thread::sleep(Duration::from_millis(100));
}

fn open(url: &str) -> Result<Connection, ConnectError> {
    let mut settings = Settings::new(url.parse().unwrap());
    settings.timeout = Duration::from_millis(500);
    settings.will = Some(Will {
        topic: "w".into(),
        payload: b"lost".to_vec(),
        expiry: 60,
        retain: true,
    });
    let subscriptions = vec![Subscription {
        filter: "t".into(),
        qos: QoS::AtMostOnce,
    }];
    Connection::open(settings, subscriptions)
}

fn levels(receiver: &Receiver<Connect>) -> Vec<u8> {
    receiver.try_iter().map(|connect| connect.level).collect()
}

#[test]
fn a_broker_that_is_silent_to_mqtt_5_is_asked_in_the_older_version_and_remembered() {
    let (url, told) = listen(|_, connect| match connect.level {
        5 => Answer::Silence,
        _ => Answer::Serve,
    });
    let connection = open(&url).unwrap();
    assert_eq!(connection.version(), Some(Version::Three));
    assert_eq!(levels(&told), [5, 4]);
    drop(connection);
    let start = Instant::now();
    assert_eq!(open(&url).unwrap().version(), Some(Version::Three));
    assert_eq!(levels(&told), [4]);
    assert!(start.elapsed() < Duration::from_millis(300));
}

#[test]
fn the_url_forces_a_version() {
    let (url, told) = listen(|_, _| Answer::Serve);
    for (option, version, level) in [
        ("?mqtt=3", Version::Three, 4),
        ("?mqtt=5", Version::Five, 5),
    ] {
        let connection = open(&format!("{url}{option}")).unwrap();
        assert_eq!(connection.version(), Some(version));
        assert_eq!(levels(&told), [level]);
    }
    let (url, told) = listen(|_, _| Answer::Silence);
    assert!(open(&format!("{url}?mqtt=5")).is_err());
    assert_eq!(levels(&told), [5]);
}

#[test]
fn a_connection_that_breaks_right_after_its_start_is_tried_again() {
    let (url, told) = listen(|number, _| match number {
        0 | 1 => Answer::Break,
        _ => Answer::Serve,
    });
    assert_eq!(open(&url).unwrap().version(), Some(Version::Five));
    assert_eq!(levels(&told), [5, 5, 5]);
    let (url, told) = listen(|_, _| Answer::Break);
    let error = open(&url).err().unwrap();
    assert!(matches!(error, ConnectError::Broken { .. }), "{error}");
    assert!(!error.to_string().contains("no MQTT broker"), "{error}");
    assert_eq!(levels(&told), [5; 5]);
}

#[test]
fn a_last_will_is_sent_as_the_broker_takes_it() {
    let (url, told) = listen(|_, connect| {
        if connect.will_qos() > 0 {
            return Answer::Refuse(0x9b); // QoS not supported
        }
        if connect.flags & 0x20 != 0 {
            return Answer::Refuse(0x9a); // retain not supported
        }
        Answer::Serve
    });
    drop(open(&url).unwrap());
    let found: Vec<(u8, u8)> = told
        .try_iter()
        .map(|one| (one.will_qos(), one.flags & 0x20))
        .collect();
    assert_eq!(found, [(1, 0x20), (0, 0x20), (0, 0)]);
    drop(open(&url).unwrap());
    assert_eq!(told.try_iter().count(), 1);
}

#[test]
fn a_busy_broker_is_asked_again_and_nobody_is_told_to_change_the_account() {
    let (url, told) = listen(|number, _| {
        if number < 2 {
            Answer::Refuse(0x89)
        } else {
            Answer::Serve
        }
    });
    open(&url).unwrap();
    assert_eq!(told.try_iter().count(), 3);
    for (version, code) in [(5, 0x89), (3, 3)] {
        let (url, _told) = listen(move |_, _| Answer::Refuse(code));
        let error = open(&format!("{url}?mqtt={version}")).err().unwrap();
        assert!(matches!(error, ConnectError::Busy { .. }), "{error}");
        let text = error.to_string();
        assert!(
            text.contains("--wait") && !text.contains("PASSWORD"),
            "{text}"
        );
    }
}
