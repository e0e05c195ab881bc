//! The connection with brokers that behave differently from the built-in one, and with listeners that are not brokers.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use std::io::{Read, Write};
use std::net::TcpListener;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use common::{PATIENCE, messages, open, settings, subscription, until};
use swarmwright_broker::{Broker, Config};
use swarmwright_mqtt::{ConnectError, Connection, Event, QoS, Version, holds_back_small_packets};

#[test]
fn an_address_without_broker_is_an_error_that_says_how_to_start_one() {
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let error = Connection::open(
        settings(&format!("mqtt://127.0.0.1:{port}")),
        subscription("t"),
    )
    .err()
    .unwrap();
    assert!(matches!(error, ConnectError::NoBroker { .. }), "{error}");
    assert!(error.to_string().contains("swarmwright broker"), "{error}");
}

#[test]
fn a_listener_that_is_not_a_broker_is_named() {
    for answer in [&b"HTTP/1.1 400 Bad Request\r\n\r\n"[..], &b""[..]] {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("mqtt://{}", listener.local_addr().unwrap());
        thread::spawn(move || {
            // MQTT 5 and 3.1.1 are both tried.
            for _ in 0..2 {
                let Ok((mut socket, _)) = listener.accept() else {
                    return;
                };
                let _ = socket.read(&mut [0; 1000]);
                let _ = socket.write_all(answer);
            }
        });
        let error = Connection::open(settings(&url), subscription("t"))
            .err()
            .unwrap();
        assert!(matches!(error, ConnectError::NoMqtt { .. }), "{error}");
    }
}

#[test]
fn a_broker_that_restarts_during_the_first_connection_is_waited_for() {
    for accepts in [false, true] {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let restarting = thread::spawn(move || {
            let (mut socket, _) = listener.accept().unwrap();
            let _ = socket.read(&mut [0; 1000]);
            drop(listener);
            if accepts {
                // CONNACK of MQTT 5; then the broker ends, as on SIGTERM.
                let _ = socket.write_all(&[0x20, 3, 0, 0, 0]);
            }
            drop(socket);
            thread::sleep(Duration::from_millis(700));
            let config = Config {
                port: Some(address.port()),
                ..Config::default()
            };
            Broker::start(&config).unwrap()
        });
        let url = format!("mqtt://{address}");
        let connection = Connection::open(settings(&url), subscription("t")).unwrap();
        assert_eq!(connection.version(), Some(Version::Five));
        drop(restarting.join().unwrap());
    }
}

#[test]
fn waiting_for_a_silent_listener_is_limited() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let start = Instant::now();
    let url = format!("mqtt://{}", listener.local_addr().unwrap());
    let error = Connection::open(settings(&url), subscription("t"))
        .err()
        .unwrap();
    assert!(matches!(error, ConnectError::NoMqtt { .. }), "{error}");
    assert!(start.elapsed() < PATIENCE);
}

/// A broker of MQTT 3.1.1: it answers MQTT 5 with return code 1, as MQTT 3.1.1 specifies, and closes.
#[test]
fn a_broker_of_mqtt_3_1_1_is_connected_to_in_3_1_1() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("mqtt://{}", listener.local_addr().unwrap());
    let (levels, seen) = mpsc::channel();
    let serving = thread::spawn(move || {
        for _ in 0..2 {
            let (mut socket, _) = listener.accept().unwrap();
            let mut buffer = [0; 1000];
            let count = socket.read(&mut buffer).unwrap();
            // Fixed header of two bytes, the name "MQTT" with its length, then the level.
            assert!(count > 9 && buffer[0] == 0x10 && &buffer[4..8] == b"MQTT");
            levels.send(buffer[8]).unwrap();
            if buffer[8] == 5 {
                socket.write_all(&[0x20, 2, 0, 1]).unwrap();
                continue;
            }
            socket.write_all(&[0x20, 2, 0, 0]).unwrap();
            let count = socket.read(&mut buffer).unwrap();
            assert!(count > 4 && buffer[0] == 0x82);
            socket
                .write_all(&[0x90, 3, buffer[2], buffer[3], 0])
                .unwrap();
            socket.write_all(b"\x30\x06\x00\x01told").unwrap();
            let _ = socket.read(&mut buffer);
        }
    });
    let mut connection = Connection::open(settings(&url), subscription("t")).unwrap();
    assert_eq!(connection.version(), Some(Version::Three));
    assert_eq!(
        messages(&mut connection, 1),
        [("t".to_owned(), b"old".to_vec(), false)]
    );
    assert_eq!(seen.try_iter().collect::<Vec<_>>(), [5, 4]);
    drop(connection);
    serving.join().unwrap();
}

#[test]
fn an_end_that_comes_together_with_a_message_is_noticed() {
    let broker = Broker::start(&Config::default()).unwrap();
    let url = broker.url();
    let address = url.trim_start_matches("mqtt://").to_owned();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let relayed = format!("mqtt://{}", listener.local_addr().unwrap());
    let (cut, wanted) = mpsc::channel();
    let (done, was_cut) = mpsc::channel();
    let relay = thread::spawn(move || {
        let (mut near, _) = listener.accept().unwrap();
        let mut far = std::net::TcpStream::connect(address).unwrap();
        let (mut from, mut to) = (near.try_clone().unwrap(), far.try_clone().unwrap());
        thread::spawn(move || std::io::copy(&mut from, &mut to));
        let mut chunk = [0; 4096];
        far.set_read_timeout(Some(Duration::from_millis(5)))
            .unwrap();
        while wanted.try_recv().is_err() {
            if let Ok(count) = far.read(&mut chunk) {
                near.write_all(&chunk[..count]).unwrap();
            }
        }
        // PUBLISH of "x" on "t", then nothing more.
        near.write_all(&[0x30, 5, 0, 1, b't', 0, b'x']).unwrap();
        near.shutdown(std::net::Shutdown::Both).unwrap();
        done.send(()).unwrap();
    });
    let mut connection = open(&relayed, "t");
    let mut events = Vec::new();
    connection.poll(Instant::now() + Duration::from_millis(50), &mut events);
    cut.send(()).unwrap();
    was_cut.recv().unwrap();
    assert_eq!(messages(&mut connection, 1)[0].1, b"x");
    until(&mut connection, |event| {
        matches!(event, Event::Disconnected { .. })
    });
    relay.join().unwrap();
}

/// A broker with Nagle's algorithm sends the second of two small messages when the first is acknowledged.
#[cfg(target_os = "linux")]
#[test]
fn small_packets_are_acknowledged_at_once() {
    const ROUNDS: usize = 31;
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("mqtt://{}", listener.local_addr().unwrap());
    let serving = thread::spawn(move || {
        let (mut socket, _) = listener.accept().unwrap();
        socket.set_nodelay(false).unwrap();
        let mut buffer = [0; 1000];
        assert!(socket.read(&mut buffer).unwrap() > 0);
        socket.write_all(&[0x20, 3, 0, 0, 0]).unwrap();
        assert!(socket.read(&mut buffer).unwrap() > 4);
        socket
            .write_all(&[0x90, 4, buffer[2], buffer[3], 0, 0])
            .unwrap();
        for _ in 0..ROUNDS {
            assert!(socket.read(&mut buffer).unwrap() > 0);
            for _ in 0..3 {
                socket.write_all(b"\x30\x05\x00\x01t\x00x").unwrap();
            }
        }
        let _ = socket.read(&mut buffer);
    });
    let mut connection = open(&url, "t");
    let mut seconds: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let start = Instant::now();
            connection.publish("question", b"", QoS::AtMostOnce, false, None);
            assert_eq!(messages(&mut connection, 3).len(), 3);
            start.elapsed().as_secs_f64()
        })
        .collect();
    seconds.sort_unstable_by(f64::total_cmp);
    // Without this, the system acknowledges after 40 ms, twice per round.
    assert!(seconds[ROUNDS / 2] < 0.03, "{seconds:?}");
    drop(connection);
    serving.join().unwrap();
}

/// Creates a broker that answers each ping with a separate write.
#[cfg(target_os = "linux")]
fn answering_pings(nodelay: bool) -> (String, thread::JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("mqtt://{}", listener.local_addr().unwrap());
    let serving = thread::spawn(move || {
        let (mut socket, _) = listener.accept().unwrap();
        socket.set_nodelay(nodelay).unwrap();
        let mut buffer = [0; 1000];
        assert!(socket.read(&mut buffer).unwrap() > 0);
        socket.write_all(&[0x20, 3, 0, 0, 0]).unwrap();
        loop {
            let count = socket.read(&mut buffer).unwrap();
            if count == 0 || buffer[0] == 0xe0 {
                return;
            }
            for _ in 0..count / 2 {
                socket.write_all(&[0xd0, 0]).unwrap();
            }
        }
    });
    (url, serving)
}

#[cfg(target_os = "linux")]
#[test]
fn brokers_that_hold_back_small_packets_are_detected() {
    for nodelay in [false, true] {
        let (url, serving) = answering_pings(nodelay);
        assert_eq!(holds_back_small_packets(&settings(&url)).unwrap(), !nodelay);
        serving.join().unwrap();
    }
    let broker = Broker::start(&Config::default()).unwrap();
    assert!(!holds_back_small_packets(&settings(&broker.url())).unwrap());
    broker.stop();
    assert!(holds_back_small_packets(&settings(&broker.url())).is_err());
}

/// Returns the bytes that the broker may not have read when the connection ended.
fn unread(connection: &mut Connection) -> usize {
    let deadline = Instant::now() + PATIENCE;
    let mut events = Vec::new();
    loop {
        assert!(Instant::now() < deadline, "the connection did not end");
        connection.poll(deadline, &mut events);
        for event in events.drain(..) {
            if let Event::Disconnected { unread, .. } = event {
                return unread;
            }
        }
    }
}

#[test]
fn what_the_broker_has_read_is_known_where_it_announces_no_limit() {
    let broker = Broker::start(&Config::default()).unwrap();
    let url = format!("{}?mqtt=3", broker.url());
    let mut connection = open(&url, "nothing");
    for size in [5000, 3000, 9000] {
        connection.publish("t", &vec![0; size], QoS::AtMostOnce, false, None);
    }
    let (deadline, mut events) = (Instant::now() + PATIENCE, Vec::new());
    while connection.largest_read() < 9000 {
        assert!(Instant::now() < deadline, "{}", connection.largest_read());
        connection.poll(Instant::now() + Duration::from_millis(10), &mut events);
    }
    assert!(connection.largest_read() < 9020);
    broker.stop();
    assert_eq!(unread(&mut connection), 0);
}

#[test]
fn what_a_broker_had_not_read_when_it_ended_the_connection_is_named() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("mqtt://{}?mqtt=3", listener.local_addr().unwrap());
    let broker = thread::spawn(move || {
        let (mut client, _) = listener.accept().unwrap();
        let mut chunk = [0; 1024];
        assert!(client.read(&mut chunk).unwrap() > 0);
        client.write_all(&[0x20, 2, 0, 0]).unwrap();
        assert!(client.read(&mut chunk).unwrap() > 0);
        client.write_all(&[0x90, 3, chunk[2], chunk[3], 1]).unwrap();
        // Only the header of the message.
        assert!(client.read(&mut chunk[..8]).unwrap() > 0);
    });
    let mut connection = open(&url, "nothing");
    connection.publish("t", &[0; 100], QoS::AtMostOnce, false, None);
    connection.publish("t", &[0; 30_000], QoS::AtMostOnce, false, None);
    let unread = unread(&mut connection);
    assert!((30_000..30_020).contains(&unread), "{unread}");
    broker.join().unwrap();
}
