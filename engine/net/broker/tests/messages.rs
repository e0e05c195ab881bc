//! Delivery of messages.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests"
)]

use crate::common;

use common::{CONNACK, Client, DISCONNECT, Hello, broker, in_time, packet, text};
use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream};
use std::thread;
use std::time::{Duration, Instant};
use swarmwright_broker::{Broker, Config, Limits};

/// Payload format, expiry 60 s, content type, response topic, correlation data, two user properties.
fn properties() -> Vec<u8> {
    let mut bytes = vec![1, 1, 2, 0, 0, 0, 60, 3];
    bytes.extend(text("application/json"));
    bytes.push(8);
    bytes.extend(text("answers/ada"));
    bytes.extend([9, 0, 3, 0, 255, 7]);
    for (name, value) in [("lease", "12"), ("lease", "13")] {
        bytes.push(0x26);
        bytes.extend(text(name));
        bytes.extend(text(value));
    }
    bytes
}

#[test]
fn properties_pass_through_unchanged_and_in_order() {
    in_time(|| {
        let broker = broker();
        let mut reader = Client::join(&broker, &Hello::default());
        reader.subscribe("requests/+", 0);
        let mut old = Client::join(
            &broker,
            &Hello {
                version: 4,
                ..Hello::default()
            },
        );
        old.subscribe("requests/#", 0);
        let mut writer = Client::join(&broker, &Hello::default());
        let message = writer.message("requests/7", false, &properties(), b"{}");
        writer.send(&message);
        assert_eq!(
            reader.hear(),
            (false, "requests/7".into(), properties(), b"{}".to_vec())
        );
        assert_eq!(
            old.hear(),
            (false, "requests/7".into(), vec![], b"{}".to_vec())
        );
        old.publish("requests/8", false, b"from 3.1.1");
        assert_eq!(
            reader.hear(),
            (false, "requests/8".into(), vec![], b"from 3.1.1".to_vec())
        );
    });
}

#[test]
fn mqtt_3_1_is_understood_and_other_protocols_are_refused() {
    in_time(|| {
        let broker = broker();
        let mut body = text("MQIsdp");
        body.extend([3, 2, 0, 0]);
        body.extend(text("old"));
        let stream = TcpStream::connect(("127.0.0.1", broker.port())).unwrap();
        let mut client = Client::new(stream, false);
        client.send(&packet(0x10, &body));
        assert_eq!(client.expect(CONNACK), [0, 0]);
        client.subscribe("t", 0);
        client.publish("t", false, b"3.1");
        assert_eq!(client.hear_payload(), "3.1");
        let (_, code) = Client::knock(
            &broker,
            &Hello {
                version: 6,
                ..Hello::default()
            },
        );
        assert_eq!(code, 1, "unacceptable protocol version");
    });
}

#[test]
fn retained_messages_reach_clients_that_subscribe_later() {
    in_time(|| {
        let broker = broker();
        let mut writer = Client::join(&broker, &Hello::default());
        for (topic, payload) in [
            ("servers/1", "ready"),
            ("servers/2", "ready"),
            ("servers/1", "busy"),
        ] {
            writer.publish(topic, true, payload.as_bytes());
        }
        // Make a round trip, so that the broker has all messages.
        writer.subscribe("servers/3", 0);
        let mut reader = Client::join(&broker, &Hello::default());
        reader.subscribe("servers/+", 0);
        assert_eq!(
            reader.hear(),
            (true, "servers/1".into(), vec![], b"busy".to_vec())
        );
        assert_eq!(
            reader.hear(),
            (true, "servers/2".into(), vec![], b"ready".to_vec())
        );
        writer.publish("servers/1", true, b"");
        assert_eq!(reader.hear(), (false, "servers/1".into(), vec![], vec![]));
        let mut late = Client::join(&broker, &Hello::default());
        late.subscribe("servers/+", 0);
        assert_eq!(late.hear().1, "servers/2");
    });
}

#[test]
fn a_killed_client_leaves_its_will() {
    in_time(|| {
        let broker = broker();
        let mut reader = Client::join(&broker, &Hello::default());
        reader.subscribe("servers/#", 0);
        for version in [4, 5] {
            let hello = Hello {
                version,
                id: "doomed",
                will: Some(("servers/1", "lost")),
                ..Hello::default()
            };
            let doomed = Client::join(&broker, &hello);
            doomed.stream.shutdown(Shutdown::Both).unwrap();
            drop(doomed);
            assert_eq!(
                reader.hear(),
                (false, "servers/1".into(), vec![], b"lost".to_vec())
            );
        }
        let mut late = Client::join(&broker, &Hello::default());
        late.subscribe("servers/#", 0);
        assert_eq!(late.hear_payload(), "lost");
    });
}

#[test]
fn a_reader_50_000_messages_behind_gets_all_in_order() {
    in_time(|| {
        const COUNT: u32 = 50_000;
        let broker = broker();
        let mut reader = Client::join(&broker, &Hello::default());
        reader.subscribe("sensor", 0);
        let mut writer = Client::join(&broker, &Hello::default());
        for number in 0..COUNT {
            let mut payload = vec![b' '; 300];
            payload[..4].copy_from_slice(&number.to_be_bytes());
            writer.publish("sensor", false, &payload);
        }
        writer.subscribe("done", 0);
        for number in 0..COUNT {
            assert_eq!(reader.hear().3[..4], number.to_be_bytes());
        }
    });
}

#[test]
fn a_reader_that_reads_slowly_is_never_cut_off() {
    in_time(|| {
        let limits = Limits {
            backlog: 1 << 20,
            ..Limits::default()
        };
        let broker = Broker::start(&Config {
            limits,
            ..Config::default()
        })
        .unwrap();
        let mut reader = Client::join(&broker, &Hello::default());
        reader.subscribe("t", 0);
        let mut writer = Client::join(&broker, &Hello::default());
        // Forty times the broker's limit, and more than the sockets buffer in addition.
        let writing = thread::spawn(move || {
            for _ in 0..40 * 64 {
                writer.publish("t", false, &[1; 1 << 14]);
            }
            writer
        });
        for round in 0..40 * 64 {
            assert_eq!(reader.hear().3.len(), 1 << 14);
            if round % 16 == 0 {
                thread::sleep(Duration::from_millis(1));
            }
        }
        writing.join().unwrap();
    });
}

#[test]
fn an_inactive_reader_does_not_delay_other_clients() {
    in_time(|| {
        let limits = Limits {
            backlog: 1 << 20,
            ..Limits::default()
        };
        let broker = Broker::start(&Config {
            limits,
            ..Config::default()
        })
        .unwrap();
        let mut stuck = Client::join(&broker, &Hello::default());
        stuck.subscribe("t", 0);
        let mut reader = Client::join(&broker, &Hello::default());
        reader.subscribe("t", 0);
        let mut writer = Client::join(&broker, &Hello::default());
        let writing = thread::spawn(move || {
            for _ in 0..2000 {
                writer.publish("t", false, &[1; 1 << 14]);
            }
            writer
        });
        let start = Instant::now();
        for _ in 0..2000 {
            assert_eq!(reader.hear().3.len(), 1 << 14);
        }
        assert!(
            start.elapsed() < Duration::from_secs(20),
            "{:?}",
            start.elapsed()
        );
        writing.join().unwrap();
        // Messages in transit arrive completely, then the reason: quota exceeded.
        let mut last = None;
        while let Some((first, body)) = stuck.next() {
            assert!(body.len() > 1 << 14 || first == DISCONNECT);
            last = Some((first, body));
        }
        let (first, body) = last.unwrap();
        assert_eq!((first, body[0]), (DISCONNECT, 0x97));
    });
}

#[test]
fn large_messages_arrive_whole_and_too_large_ones_are_refused() {
    in_time(|| {
        let broker = broker();
        let mut client = Client::join(&broker, &Hello::default());
        client.subscribe("blob", 0);
        let blob: Vec<u8> = (0..10_000_000u32)
            .map(|place| ((place * 7) >> 3) as u8)
            .collect();
        client.publish("blob", false, &blob);
        assert!(client.hear().3 == blob);
        // Only a length of 200 MB, without a body.
        client.send(&[0x30, 0x80, 0x84, 0xaf, 0x5f]);
        assert_eq!(client.expect(DISCONNECT)[0], 0x95);
    });
}

#[test]
fn malformed_packets_end_only_their_connection() {
    in_time(|| {
        let broker = broker();
        let mut honest = Client::join(&broker, &Hello::default());
        honest.subscribe("t", 0);
        for junk in [
            &b"GET / HTTP/1.1\r\n\r\n"[..],
            &[0; 64],
            &[0xff; 64],
            &[0x10, 3, 0, 4, b'M'],
        ] {
            let mut stream = TcpStream::connect(("127.0.0.1", broker.port())).unwrap();
            stream.write_all(junk).unwrap();
            stream
                .set_read_timeout(Some(Duration::from_secs(20)))
                .unwrap();
            let mut rest = Vec::new();
            let _ = stream.read_to_end(&mut rest);
        }
        honest.publish("t", false, b"still here");
        assert_eq!(honest.hear_payload(), "still here");
    });
}
