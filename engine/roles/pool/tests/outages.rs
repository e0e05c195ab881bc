//! Loss of the broker while a tool looks for servers.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;
use std::time::Duration;

use serde_json::Map;
use swarmwright_mqtt::Settings;
use swarmwright_pool::{Demand, Faults, Mode, Options, Pool, PoolError, Timeouts};
use swarmwright_protocol::Requirements;

/// Accepts a client of MQTT 5 with five subscriptions, as a broker does.
fn welcome(listener: &TcpListener) -> TcpStream {
    let (mut socket, _) = listener.accept().unwrap();
    let mut buffer = [0; 4096];
    assert!(socket.read(&mut buffer).unwrap() > 0);
    socket.write_all(&[0x20, 3, 0, 0, 0]).unwrap();
    assert!(socket.read(&mut buffer).unwrap() > 4 && buffer[0] == 0x82);
    // The length field has two bytes from 128 on.
    let id = 2 + usize::from(buffer[1] >= 128);
    let granted = [0x90, 8, buffer[id], buffer[id + 1], 0, 0, 0, 0, 0, 1];
    socket.write_all(&granted).unwrap();
    socket
}

fn pool(listener: &TcpListener, discovery: Duration) -> Pool {
    let url = format!("mqtt://{}", listener.local_addr().unwrap());
    let options = Options {
        settings: Settings::new(url.parse().unwrap()),
        prefix: String::new(),
        tool: "a".to_owned(),
        demand: Demand {
            simulation: "line".to_owned(),
            requirements: Requirements {
                dimensions: 2.0,
                max_agents: None,
            },
            sensors: None,
            actuators: None,
            mode: Mode::Auto,
            kind: None,
            modules: Vec::new(),
            metrics: Vec::new(),
        },
        parameters: Map::new(),
        visual: false,
        timeouts: Timeouts {
            discovery,
            ..Timeouts::default()
        },
        faults: Faults::default(),
        largest: 1000,
        alone: false,
    };
    Pool::connect(options).unwrap()
}

#[test]
fn a_broker_that_is_lost_is_named_and_not_the_servers() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let serving = listener.try_clone().unwrap();
    let broker = thread::spawn(move || drop(welcome(&serving)));
    let mut pool = pool(&listener, Duration::from_millis(300));
    broker.join().unwrap();
    drop(listener);
    let mut waits = Vec::new();
    let error = pool.wait_for_server(true, |reason| {
        waits.push(reason.to_owned());
        true
    });
    let error = error.unwrap_err();
    assert!(matches!(error, PoolError::BrokerLost { .. }), "{error}");
    let told = error.to_string();
    for part in ["was not reachable from ", " to ", "check that it runs"] {
        assert!(told.contains(part), "{told}");
    }
    assert!(!told.contains("no server fits"), "{told}");
    let waits_for_broker = waits.iter().any(|reason| reason.contains("the broker on"));
    assert!(waits_for_broker, "{waits:?}");
}

#[test]
fn time_without_broker_is_not_held_against_servers() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let serving = listener.try_clone().unwrap();
    let broker = thread::spawn(move || {
        drop(welcome(&serving));
        let mut socket = welcome(&serving);
        // Wait until the tool disconnects.
        let _ = socket.read_to_end(&mut Vec::new());
    });
    let mut pool = pool(&listener, Duration::from_millis(300));
    let error = pool.wait_for_server(true, |_| true).unwrap_err();
    let told = error.to_string();
    assert!(
        matches!(error, PoolError::NoServer { nothing: true, .. }),
        "{told}"
    );
    assert!(
        told.contains("while the broker was not reachable from "),
        "{told}"
    );
    pool.close();
    broker.join().unwrap();
}
