//! Start of a broker, and errors that prevent it.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests"
)]

use crate::common;

use common::{Client, Hello, broker, in_time};
use std::net::TcpListener;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use swarmwright_broker::{Broker, BrokerError, Config};

fn failure(config: &Config) -> BrokerError {
    Broker::start(config).expect_err("this configuration cannot work")
}

fn data(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(name)
}

#[test]
fn it_starts_within_100_ms_and_serves_at_once() {
    in_time(|| {
        let start = Instant::now();
        let broker = broker();
        assert!(
            start.elapsed() < Duration::from_millis(100),
            "{:?}",
            start.elapsed()
        );
        assert_eq!(broker.url(), format!("mqtt://127.0.0.1:{}", broker.port()));
        let mut client = Client::join(&broker, &Hello::default());
        client.subscribe("t", 0);
        client.publish("t", false, b"hello");
        assert_eq!(client.hear_payload(), "hello");
    });
}

#[test]
fn an_occupied_port_is_named() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    for config in [
        Config {
            port: Some(port),
            ..Config::default()
        },
        Config {
            websocket_port: Some(port),
            ..Config::default()
        },
    ] {
        let error = failure(&config);
        assert!(matches!(error, BrokerError::AddressInUse { .. }));
        assert!(
            error
                .to_string()
                .contains(&format!("127.0.0.1:{port} is in use")),
            "{error}"
        );
    }
}

#[test]
fn an_address_of_another_machine_is_named() {
    for host in ["192.0.2.1", "no-such-host.invalid"] {
        let error = failure(&Config {
            host: host.into(),
            ..Config::default()
        });
        assert!(matches!(error, BrokerError::AddressNotOurs { .. }));
        assert!(error.to_string().contains(host), "{error}");
    }
}

#[test]
fn files_that_cannot_be_used_are_named_with_their_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    std::fs::write(&path, "# comment\n\nada:secret\nnonsense\n").unwrap();
    let missing = folder.path().join("missing");
    let here = path.display().to_string();
    let gone = missing.display().to_string();
    let some = |path: &PathBuf| Some(path.clone());
    let cases = [
        (
            Config {
                users: some(&missing),
                ..Config::default()
            },
            vec!["password file", &gone],
        ),
        (
            Config {
                users: some(&path),
                ..Config::default()
            },
            vec!["password file", &here, "line 3", "mosquitto_passwd"],
        ),
        (
            Config {
                access: some(&path),
                ..Config::default()
            },
            vec!["access file", &here, "line 3", "topic"],
        ),
        (
            Config {
                certificate: some(&path),
                ..Config::default()
            },
            vec!["the key is missing"],
        ),
        (
            Config {
                key: some(&path),
                ..Config::default()
            },
            vec!["the certificate is missing"],
        ),
        (
            Config {
                certificate: some(&missing),
                key: some(&missing),
                ..Config::default()
            },
            vec!["certificate", &gone, "check the path"],
        ),
        (
            Config {
                certificate: some(&path),
                key: some(&path),
                ..Config::default()
            },
            vec!["certificate", &here, "-----BEGIN"],
        ),
    ];
    for (config, words) in cases {
        let message = failure(&config).to_string();
        for word in words {
            assert!(message.contains(word), "{word} in: {message}");
        }
    }
    assert!(
        Broker::start(&Config {
            users: Some(data("users")),
            ..Config::default()
        })
        .is_ok()
    );
}
