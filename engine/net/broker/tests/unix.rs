//! Unix sockets: their files, and clients that connect through them.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests"
)]

use crate::common;

use common::{CONNACK, Client, Hello, in_time};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::time::Duration;
use swarmwright_broker::{Broker, BrokerError, Config};

fn config(path: &Path) -> Config {
    Config {
        port: None,
        socket: Some(path.to_owned()),
        ..Config::default()
    }
}

fn join(path: &Path) -> Client<UnixStream> {
    let stream = UnixStream::connect(path).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    let mut client = Client::over(stream, &Hello::default());
    assert_eq!(client.expect(CONNACK)[1], 0, "CONNACK");
    client
}

fn mode(path: &Path) -> u32 {
    fs::metadata(path).unwrap().permissions().mode() & 0o777
}

fn failure(path: &Path) -> String {
    let error = Broker::start(&config(path)).expect_err("this path cannot work");
    error.to_string()
}

#[test]
fn clients_of_a_socket_and_of_a_port_reach_each_other() {
    in_time(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broker.sock");
        let broker = Broker::start(&Config {
            port: Some(0),
            ..config(&path)
        })
        .unwrap();
        assert_eq!(
            broker.socket_url(),
            Some(format!("unix://{}", path.display()))
        );
        let mut far = Client::join(&broker, &Hello::default());
        far.subscribe("t", 0);
        let mut near = join(&path);
        // More than a socket accepts at once.
        let large = vec![b'x'; 4 << 20];
        near.publish("t", false, &large);
        near.publish("t", false, b"end");
        assert_eq!(far.hear().3.len(), large.len());
        assert_eq!(far.hear_payload(), "end");
        near.subscribe("u", 0);
        far.publish("u", false, b"back");
        assert_eq!(near.hear_payload(), "back");
    });
}

#[test]
fn the_file_is_the_owners_alone_and_ends_with_the_broker() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broker.sock");
    let broker = Broker::start(&config(&path)).unwrap();
    assert_eq!((mode(&path), broker.port()), (0o600, 0));
    assert_eq!(broker.url(), format!("unix://{}", path.display()));
    broker.stop();
    assert!(!path.exists());
    let shared = Broker::start(&Config {
        socket_mode: 0o660,
        ..config(&path)
    })
    .unwrap();
    assert_eq!(mode(&path), 0o660);
    drop(shared);
    assert!(!path.exists());
}

#[test]
fn a_file_that_was_left_behind_is_replaced_and_one_in_use_is_not() {
    in_time(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broker.sock");
        drop(UnixListener::bind(&path).unwrap());
        let first = Broker::start(&config(&path)).unwrap();
        let error = Broker::start(&config(&path)).expect_err("in use");
        assert!(matches!(error, BrokerError::SocketInUse { .. }), "{error}");
        let mut client = join(&path);
        // A broker whose file was moved must not remove the file of its successor.
        fs::rename(&path, folder.path().join("other")).unwrap();
        let second = Broker::start(&config(&path)).unwrap();
        client.subscribe("t", 0);
        client.publish("t", false, b"still here");
        assert_eq!(client.hear_payload(), "still here");
        first.stop();
        join(&path);
        second.stop();
        assert!(!path.exists());
    });
}

#[test]
fn of_brokers_that_start_at_once_one_listens() {
    in_time(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broker.sock");
        drop(UnixListener::bind(&path).unwrap());
        let starting: Vec<_> = (0..8)
            .map(|_| {
                let config = config(&path);
                std::thread::spawn(move || Broker::start(&config).ok())
            })
            .collect();
        let started: Vec<_> = starting
            .into_iter()
            .filter_map(|thread| thread.join().unwrap())
            .collect();
        assert_eq!(started.len(), 1);
        join(&path);
    });
}

#[test]
fn paths_that_cannot_be_say_why() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("notes.txt");
    fs::write(&file, "kept").unwrap();
    assert!(failure(&file).contains("is a file of another kind"));
    assert_eq!(fs::read(&file).unwrap(), b"kept");
    let missing = folder.path().join("missing").join("broker.sock");
    assert!(failure(&missing).contains("missing does not exist; create it"));
    let long = folder.path().join("x".repeat(108));
    assert!(failure(&long).contains("choose a shorter path"));
    let nothing = Broker::start(&Config {
        port: None,
        ..Config::default()
    });
    assert!(
        nothing
            .expect_err("nothing to listen on")
            .to_string()
            .contains("neither a port nor")
    );
}
