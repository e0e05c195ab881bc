//! Attacks over real sockets: memory stays bounded, and other clients are served.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests"
)]

mod common;

use common::{CONNACK, Client, Hello, SUBACK, in_time, packet, text};
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use swarmwright_broker::{Broker, Config, Limits};

/// Lock for one attack at a time, since the memory of the whole process is measured.
static ALONE: Mutex<()> = Mutex::new(());

fn alone(test: impl FnOnce() + Send + 'static) {
    let _turn = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    in_time(test);
}

const MIB: usize = 1 << 20;
const BUDGET: usize = 64 * MIB;

fn broker() -> Broker {
    let config = Config {
        websocket_port: Some(0),
        limits: Limits {
            memory: BUDGET,
            ..Limits::default()
        },
        ..Config::default()
    };
    Broker::start(&config).unwrap()
}

/// Returns the memory of this process in bytes; the broker is one of its threads.
fn memory() -> usize {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap();
    text.split(' ').nth(1).unwrap().parse::<usize>().unwrap() * 4096
}

/// Writes until the peer accepts nothing for a while, or `most` bytes are written. Returns the number of accepted
/// bytes.
fn flood(stream: &mut TcpStream, bytes: &[u8], most: usize) -> usize {
    stream
        .set_write_timeout(Some(Duration::from_millis(300)))
        .unwrap();
    let mut sent = 0;
    while sent < most {
        match stream.write(bytes) {
            Ok(count) => sent += count,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                break;
            }
            Err(_) => break,
        }
    }
    sent
}

/// Checks that a message makes a round trip.
fn is_served(client: &mut Client<TcpStream>) {
    client.publish("echo", false, b"still there?");
    assert_eq!(client.hear_payload(), "still there?");
}

fn honest(broker: &Broker) -> Client<TcpStream> {
    let mut client = Client::join(broker, &Hello::default());
    client.subscribe("echo", 0);
    client
}

/// Opens an unauthenticated connection on the WebSocket port.
fn unauthenticated(broker: &Broker) -> TcpStream {
    let mut stream = TcpStream::connect(("127.0.0.1", broker.websocket_port().unwrap())).unwrap();
    let request = "GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: mqtt\r\n\r\n";
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = [0; 1024];
    let count = stream.read(&mut answer).unwrap();
    assert!(answer[..count].starts_with(b"HTTP/1.1 101"));
    stream
}

#[test]
fn pings_of_unauthenticated_clients_whose_answers_are_not_read() {
    alone(|| {
        let broker = broker();
        let mut other = honest(&broker);
        // A masked PING with 125 bytes, repeated many times.
        let mut ping = vec![0x89, 0x80 | 125, 1, 2, 3, 4];
        ping.extend([7; 125]);
        let pings = ping.repeat(500);
        let before = memory();
        let mut clients: Vec<TcpStream> = (0..4).map(|_| unauthenticated(&broker)).collect();
        for client in &mut clients {
            // The sockets' own buffers accept some megabytes.
            let sent = flood(client, &pings, 200 * MIB);
            assert!(sent < 50 * MIB, "{sent} bytes were taken");
            is_served(&mut other);
        }
        assert!(
            memory() < before + BUDGET,
            "{} MiB",
            (memory() - before) / MIB
        );
    });
}

#[test]
fn acknowledgements_that_are_not_read() {
    alone(|| {
        let broker = broker();
        let mut other = honest(&broker);
        let mut rude = Client::join(&broker, &Hello::default());
        let mut body = text("no/reader");
        body.extend([0, 1, 0]);
        let publishes = packet(0x32, &body).repeat(5000);
        let sent = flood(&mut rude.stream, &publishes, 400 * MIB);
        assert!(sent < 50 * MIB, "{sent} bytes were taken");
        is_served(&mut other);
    });
}

#[test]
fn a_subscribe_with_very_many_filters() {
    alone(|| {
        let broker = broker();
        let mut other = honest(&broker);
        let mut writer = Client::join(&broker, &Hello::default());
        for number in 0..20_000 {
            let mut body = text(&format!("kept/{number}/x"));
            body.extend([0, 1]);
            writer.stream.write_all(&packet(0x31, &body)).unwrap();
        }
        let mut greedy = Client::join(&broker, &Hello::default());
        let mut body = vec![0, 1, 0];
        for number in 0..300_000 {
            body.extend(text(&format!("+/+/{number}")));
            body.push(0);
        }
        greedy.stream.write_all(&packet(0x82, &body)).unwrap();
        let codes = greedy.expect(SUBACK);
        assert_eq!(codes.len(), 3 + 300_000);
        // Thousands of searches through 20,000 retained messages are in progress now.
        for _ in 0..100 {
            is_served(&mut other);
        }
    });
}

#[test]
fn packets_that_never_end() {
    alone(|| {
        let broker = broker();
        let mut other = honest(&broker);
        let before = memory();
        let mut streams = Vec::new();
        for _ in 0..20 {
            let mut client = Client::join(&broker, &Hello::default());
            // A PUBLISH of 60 MiB, of which 20 MiB are sent.
            client
                .stream
                .write_all(&[0x30, 0x80, 0x80, 0x80, 0x1e])
                .unwrap();
            flood(&mut client.stream, &[0; 1 << 16], 20 * MIB);
            streams.push(client);
            is_served(&mut other);
        }
        // Buffers grow by doubling, and the old and the new one exist at the same time for a moment.
        assert!(
            memory() < before + 3 * BUDGET,
            "{} MiB",
            (memory() - before) / MIB
        );
    });
}

#[test]
fn sessions_that_outlive_their_connections() {
    alone(|| {
        let broker = broker();
        let mut other = honest(&broker);
        let before = memory();
        for number in 0..2000u32 {
            let mut stream = TcpStream::connect(("127.0.0.1", broker.port())).unwrap();
            let mut body = text("MQTT");
            // A will of 60 kB, and a session of an hour.
            body.extend([5, 4, 0, 0, 5, 0x11]);
            body.extend(3600u32.to_be_bytes());
            body.extend(text(&format!("away-{number}")));
            body.push(5);
            body.push(0x18);
            body.extend(3600u32.to_be_bytes());
            body.extend(text("will"));
            body.extend(text(&"x".repeat(60_000)));
            stream.write_all(&packet(0x10, &body)).unwrap();
            let mut answer = [0; 2];
            stream.read_exact(&mut answer).unwrap();
            assert_eq!(answer[0], CONNACK);
        }
        is_served(&mut other);
        assert!(
            memory() < before + 2 * BUDGET,
            "{} MiB",
            (memory() - before) / MIB
        );
    });
}
