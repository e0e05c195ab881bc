//! Connections through Unix sockets.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use std::os::unix::net::UnixListener;
use std::path::Path;

use common::{PATIENCE, messages, open, settings, subscription, until};
use swarmwright_broker::{Broker, Config};
use swarmwright_mqtt::{ConnectError, Connection, Event, QoS, Settings};

fn broker(path: &Path) -> Broker {
    Broker::start(&Config {
        port: None,
        socket: Some(path.to_owned()),
        ..Config::default()
    })
    .unwrap()
}

#[test]
fn messages_of_any_size_arrive_also_after_a_loss() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broker.sock");
    let first = broker(&path);
    let url = first.url();
    let mut reader = open(&url, "t");
    let mut brokers = vec![first];
    for round in 0..2u8 {
        let mut writer = open(&url, "nothing");
        // More than the socket accepts at once.
        let big = vec![round; 3_000_000];
        writer.publish("t", &big, QoS::AtMostOnce, false, None);
        writer.publish("t", b"small", QoS::AtLeastOnce, false, None);
        writer.close(PATIENCE);
        let found = messages(&mut reader, 2);
        assert_eq!((&found[0].1, found[1].1.as_slice()), (&big, &b"small"[..]));
        if round == 0 {
            brokers[0].stop();
            until(&mut reader, |event| {
                matches!(event, Event::Disconnected { .. })
            });
            brokers.push(broker(&path));
            until(&mut reader, |event| matches!(event, Event::Connected));
        }
    }
}

#[test]
fn the_next_broker_of_a_list_is_used_instead() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broker.sock");
    let near = broker(&path);
    let far = Broker::start(&Config::default()).unwrap();
    let list = Settings::from_environment(&format!("{},{}", near.url(), far.url())).unwrap();
    let mut reader = Connection::open(list, subscription("t")).unwrap();
    assert_eq!(reader.url(), near.url());
    near.stop();
    until(&mut reader, |event| matches!(event, Event::Connected));
    assert_eq!(reader.url(), far.url());
}

#[test]
fn what_is_wrong_with_a_socket_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (stale, file) = (folder.path().join("stale"), folder.path().join("file"));
    drop(UnixListener::bind(&stale).unwrap());
    std::fs::write(&file, "").unwrap();
    for (path, why) in [
        (folder.path().join("missing"), "the file does not exist"),
        (stale, "no process listens at this socket"),
        (file, "the file is not a socket"),
    ] {
        let url = format!("unix://{}", path.display());
        let error = Connection::open(settings(&url), subscription("t"))
            .err()
            .unwrap();
        assert!(matches!(error, ConnectError::NoBroker { .. }), "{error}");
        let text = error.to_string();
        assert!(text.contains(why) && text.contains(&url), "{text}");
    }
}
