//! Stopping a broker frees its ports and threads.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests"
)]

mod common;

use common::{Client, DISCONNECT, Hello, broker, in_time};
use std::net::TcpStream;
use swarmwright_broker::{Broker, Config};

#[test]
fn stopping_tells_the_clients_and_frees_port_and_threads() {
    in_time(|| {
        let first = broker();
        let config = Config {
            port: Some(first.port()),
            ..Config::default()
        };
        let mut clients: Vec<_> = (0..5)
            .map(|_| Client::join(&first, &Hello::default()))
            .collect();
        first.stop();
        first.stop();
        for client in &mut clients {
            // 0x8b: the server is shutting down.
            assert_eq!(client.expect(DISCONNECT)[0], 0x8b);
            assert_eq!(client.next(), None);
        }
        for _ in 0..20 {
            let again = Broker::start(&config).unwrap();
            drop(Client::join(&again, &Hello::default()));
        }
        assert!(TcpStream::connect(("127.0.0.1", first.port())).is_err());
        assert_eq!(broker_threads(), 0);
    });
}

/// Returns the number of broker threads in this process, by name. This test has its own file, because other tests have
/// brokers, too.
fn broker_threads() -> usize {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else {
        return 0;
    };
    let names = tasks
        .flatten()
        .filter_map(|task| std::fs::read_to_string(task.path().join("comm")).ok());
    names.filter(|name| name.trim() == "mqtt-broker").count()
}
