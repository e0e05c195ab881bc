//! The connection with the built-in broker.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use std::thread;
use std::time::{Duration, Instant};

use common::{PATIENCE, messages, open, settings, subscription, until};
use swarmwright_broker::{Broker, Config};
use swarmwright_mqtt::{ConnectError, Connection, Event, PublishOptions, QoS, Version, Will};

#[test]
fn messages_of_any_size_arrive_in_order() {
    let broker = Broker::start(&Config::default()).unwrap();
    let mut reader = open(&broker.url(), "t/#");
    let mut writer = open(&broker.url(), "nothing");
    assert_eq!(writer.version(), Some(Version::Five));
    let sent: Vec<Vec<u8>> = (0..300u32)
        .map(|size| vec![size as u8; (size * size) as usize])
        .collect();
    let expected = sent.clone();
    let writing = thread::spawn(move || {
        let mut events = Vec::new();
        for (index, payload) in sent.iter().enumerate() {
            let qos = if index % 2 == 0 {
                QoS::AtMostOnce
            } else {
                QoS::AtLeastOnce
            };
            writer.publish("t/x", payload, qos, false, None);
            if index % 10 == 0 {
                writer.poll(Instant::now(), &mut events);
            }
        }
        writer.close(PATIENCE);
    });
    let found = messages(&mut reader, expected.len());
    writing.join().unwrap();
    let payloads: Vec<Vec<u8>> = found.into_iter().map(|(_, payload, _)| payload).collect();
    assert_eq!(payloads, expected);
}

#[test]
fn what_is_retained_comes_with_the_subscription_and_is_marked() {
    let broker = Broker::start(&Config::default()).unwrap();
    let mut writer = open(&broker.url(), "nothing");
    writer.publish("r/1", b"kept", QoS::AtLeastOnce, true, Some(60));
    writer.close(PATIENCE);
    let mut reader = open(&broker.url(), "r/#");
    assert_eq!(
        messages(&mut reader, 1),
        [("r/1".to_owned(), b"kept".to_vec(), true)]
    );
}

#[test]
fn it_is_told_what_the_broker_does_not_let_publish() {
    let folder = tempfile::tempdir().unwrap();
    let rules = folder.path().join("access");
    std::fs::write(&rules, "topic read #\ntopic write allowed\n").unwrap();
    let broker = Broker::start(&Config {
        access: Some(rules),
        ..Config::default()
    })
    .unwrap();
    let mut writer = open(&broker.url(), "nothing");
    for topic in ["allowed", "denied"] {
        writer.publish_logged(topic, b"", &PublishOptions::CONFIRMED);
    }
    until(&mut writer, |event| match event {
        Event::Denied { topic, message } => {
            assert_eq!(topic, "denied");
            let words = "does not let a client without a user name publish on \"denied\" (";
            assert!(message.contains(words), "{message}");
            true
        }
        _ => false,
    });
}

#[test]
fn the_last_will_is_published_after_a_loss_and_not_after_a_disconnection() {
    let broker = Broker::start(&Config::default()).unwrap();
    let mut reader = open(&broker.url(), "w");
    let with_will = || {
        let mut settings = settings(&broker.url());
        settings.will = Some(Will {
            topic: "w".into(),
            payload: b"lost".to_vec(),
            expiry: 60,
            retain: true,
        });
        Connection::open(settings, subscription("nothing")).unwrap()
    };
    with_will().close(PATIENCE);
    drop(with_will());
    assert_eq!(messages(&mut reader, 1)[0].1, b"lost");
    let mut events = Vec::new();
    reader.poll(Instant::now() + Duration::from_millis(100), &mut events);
    assert!(events.is_empty(), "{events:?}");
}

#[test]
fn a_connection_reconnects_with_its_subscriptions() {
    let broker = Broker::start(&Config::default()).unwrap();
    let (url, port) = (broker.url(), broker.port());
    let mut reader = open(&url, "t");
    broker.stop();
    until(&mut reader, |event| {
        matches!(event, Event::Disconnected { .. })
    });
    assert_eq!(reader.version(), None);
    reader.publish("t", b"into the void", QoS::AtMostOnce, false, None);
    let _broker = Broker::start(&Config {
        port: Some(port),
        ..Config::default()
    })
    .unwrap();
    until(&mut reader, |event| matches!(event, Event::Connected));
    let mut writer = open(&url, "nothing");
    writer.publish("t", b"again", QoS::AtMostOnce, false, None);
    writer.close(PATIENCE);
    assert_eq!(messages(&mut reader, 1)[0].1, b"again");
}

#[test]
fn a_waker_ends_a_poll() {
    let broker = Broker::start(&Config::default()).unwrap();
    let mut reader = open(&broker.url(), "t");
    let waker = reader.waker();
    let start = Instant::now();
    let waking = thread::spawn(move || {
        thread::sleep(Duration::from_millis(50));
        waker.wake();
    });
    let mut events = Vec::new();
    while !waking.is_finished() {
        assert!(start.elapsed() < PATIENCE);
        reader.poll(Instant::now() + PATIENCE, &mut events);
    }
    waking.join().unwrap();
}

#[test]
fn websockets_carry_the_same() {
    let broker = Broker::start(&Config {
        websocket_port: Some(0),
        ..Config::default()
    })
    .unwrap();
    let url = broker.websocket_url().unwrap();
    let mut reader = open(&url, "t");
    let mut writer = open(&url, "nothing");
    let big = vec![7; 300_000];
    writer.publish("t", &big, QoS::AtMostOnce, false, None);
    writer.publish("t", b"small", QoS::AtMostOnce, false, None);
    writer.close(PATIENCE);
    let found = messages(&mut reader, 2);
    assert_eq!(
        (found[0].1.len(), found[1].1.as_slice()),
        (big.len(), &b"small"[..])
    );
}

#[test]
fn tls_is_checked_against_the_named_authority() {
    let folder = tempfile::tempdir().unwrap();
    let identity = rcgen::generate_simple_self_signed(vec!["localhost".to_owned()]).unwrap();
    let (certificate, key) = (
        folder.path().join("cert.pem"),
        folder.path().join("key.pem"),
    );
    std::fs::write(&certificate, identity.cert.pem()).unwrap();
    std::fs::write(&key, identity.signing_key.serialize_pem()).unwrap();
    let config = Config {
        certificate: Some(certificate.clone()),
        key: Some(key),
        ..Config::default()
    };
    let broker = Broker::start(&config).unwrap();
    let url = format!("mqtts://localhost:{}", broker.port());

    let untrusting = Connection::open(settings(&url), subscription("t"))
        .err()
        .unwrap();
    assert!(
        matches!(untrusting, ConnectError::Tls { .. }),
        "{untrusting}"
    );
    assert!(
        untrusting.to_string().contains("SWARMWRIGHT_CA_FILE"),
        "{untrusting}"
    );

    let mut trusting = settings(&url);
    trusting.ca_file = Some(certificate);
    let mut both = Connection::open(trusting.clone(), subscription("t")).unwrap();
    let mut writer = Connection::open(trusting, subscription("nothing")).unwrap();
    writer.publish("t", &vec![1; 200_000], QoS::AtMostOnce, false, None);
    writer.close(PATIENCE);
    assert_eq!(messages(&mut both, 1)[0].1.len(), 200_000);
}

#[test]
fn the_certificate_of_an_authority_is_refused_as_that_of_a_broker() {
    let folder = tempfile::tempdir().unwrap();
    let mut authority = rcgen::CertificateParams::new(vec!["localhost".to_owned()]).unwrap();
    authority.is_ca = rcgen::IsCa::Ca(rcgen::BasicConstraints::Unconstrained);
    let signing_key = rcgen::KeyPair::generate().unwrap();
    let identity = authority.self_signed(&signing_key).unwrap();
    let (certificate, key) = (
        folder.path().join("cert.pem"),
        folder.path().join("key.pem"),
    );
    std::fs::write(&certificate, identity.pem()).unwrap();
    std::fs::write(&key, signing_key.serialize_pem()).unwrap();
    let broker = Broker::start(&Config {
        certificate: Some(certificate.clone()),
        key: Some(key),
        ..Config::default()
    })
    .unwrap();

    let mut trusting = settings(&format!("mqtts://localhost:{}", broker.port()));
    trusting.ca_file = Some(certificate);
    let refused = Connection::open(trusting, subscription("t")).err().unwrap();
    let said = refused.to_string();
    assert!(said.contains("that of an authority (CA:TRUE)"), "{said}");
}
