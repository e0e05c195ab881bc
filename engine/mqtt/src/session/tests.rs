use super::*;
use crate::dialect::Dialect;
use crate::settings::Settings;

const VERSIONS: [Version; 2] = [Version::V5, Version::V3];

/// A session that the broker has accepted, with `properties` (MQTT 5) in its CONNACK.
fn accepted(version: Version, properties: &[u8]) -> Session {
    let mut session = Session::new(version, 30);
    let settings = Settings::new("mqtt://localhost".parse().unwrap());
    let dialect = Dialect::first(Some(version));
    session
        .connect(&settings, "me", dialect, &mut Vec::new())
        .unwrap();
    let mut connack = vec![0x20, 2, 0, 0];
    if version == Version::V5 {
        let length = u8::try_from(properties.len()).unwrap();
        connack[1] = 3 + length;
        connack.push(length);
        connack.extend_from_slice(properties);
    }
    let mut answers = Vec::new();
    session.receive(&connack, &mut Vec::new(), &mut |it| answers.push(it));
    assert!(matches!(answers[..], [Received::Accepted]), "{answers:?}");
    session
}

/// What came in, as far as it can be seen from outside.
fn messages(session: &mut Session, pieces: &[&[u8]]) -> Vec<(String, Vec<u8>, bool)> {
    let mut found = Vec::new();
    for piece in pieces {
        session.receive(piece, &mut Vec::new(), &mut |received| match received {
            Received::Publish(it) => {
                found.push((it.topic().to_owned(), it.payload().to_vec(), it.retained()));
            }
            other => panic!("{other:?}"),
        });
    }
    found
}

/// With a random choice of what a message may have.
fn options(random: &mut fastrand::Rng) -> PublishOptions<'static> {
    PublishOptions {
        expiry: random.bool().then(|| random.u32(1..)),
        content_type: random.bool().then_some("application/msgpack"),
        response_topic: random.bool().then_some("lab/swärm/v1/tool/7f3a"),
        correlation: random.bool().then_some(&[0, 1, 2, 3, 4, 5, 6, 255]),
        ..PublishOptions::default()
    }
}

#[test]
fn a_plain_message_is_written_as_the_crate_writes_it() {
    let mut random = fastrand::Rng::with_seed(11);
    for version in VERSIONS {
        let mut session = accepted(version, &[]);
        for topic in ["s", "sensor", "lab/1/äctuator", &"x".repeat(200)] {
            for size in [0, 1, 100, 127, 128, 16_300, 16_384, 2_100_000] {
                let payload: Vec<u8> = (0..size).map(|_| fastrand::u8(..)).collect();
                let (mut ours, mut theirs) = (Vec::new(), Vec::new());
                let options = options(&mut random);
                assert!(plain::write(
                    topic,
                    &payload,
                    &options,
                    version,
                    usize::MAX,
                    &mut ours
                ));
                session
                    .publish_by_core(topic, &payload, &options, &mut theirs)
                    .unwrap();
                assert_eq!(ours, theirs, "{version:?} {topic} {size} {options:?}");
            }
        }
    }
}

#[test]
fn messages_are_read_as_the_crate_reads_them_wherever_the_stream_is_cut() {
    let mut random = fastrand::Rng::with_seed(7);
    for version in VERSIONS {
        let mut stream = Vec::new();
        let mut sender = accepted(version, &[]);
        for number in 0..300 {
            let size = [0, 3, 150, 300, 20_000][random.usize(..5)];
            let payload: Vec<u8> = (0..size).map(|_| random.u8(..)).collect();
            let qos = [QoS::AtMostOnce, QoS::AtMostOnce, QoS::AtLeastOnce][random.usize(..3)];
            let options = PublishOptions {
                qos,
                retain: random.bool(),
                ..options(&mut random)
            };
            let topic = format!("topic/{number}");
            sender
                .publish_by_core(&topic, &payload, &options, &mut stream)
                .unwrap();
        }
        let mut reference = accepted(version, &[]);
        reference.accepted = false; // everything through the crate
        let expected = messages(&mut reference, &[&stream]);
        assert_eq!(expected.len(), 300);
        let mut pieces = Vec::new();
        let mut rest = &stream[..];
        while !rest.is_empty() {
            let most = [1, 5, 400, 65_536][random.usize(..4)].min(rest.len());
            let (piece, later) = rest.split_at(random.usize(1..=most));
            pieces.push(piece);
            rest = later;
        }
        assert_eq!(messages(&mut accepted(version, &[]), &pieces), expected);
    }
}

#[test]
fn properties_that_cannot_be_are_refused() {
    let long = [0; 70_000];
    let bad = [
        PublishOptions {
            response_topic: Some("a/+"),
            ..PublishOptions::default()
        },
        PublishOptions {
            correlation: Some(&long),
            ..PublishOptions::default()
        },
    ];
    let mut session = accepted(Version::V5, &[]);
    for options in bad {
        let mut out = Vec::new();
        assert!(session.publish("t", b"", &options, &mut out).is_err());
        assert!(out.is_empty());
    }
}

#[test]
fn a_message_larger_than_the_broker_takes_is_refused() {
    // Property 39, maximum packet size: 100.
    let mut session = accepted(Version::V5, &[39, 0, 0, 0, 100]);
    let mut send = |size: usize| {
        let mut out = Vec::new();
        let sent = session.publish("t", &vec![0; size], &PublishOptions::default(), &mut out);
        (sent.is_ok(), out.len())
    };
    // Fixed header 2, topic 3, property length 1.
    assert_eq!(send(94), (true, 100));
    assert_eq!(send(95), (false, 0));
}

#[test]
fn a_broker_that_denies_a_topic_is_heard() {
    let mut session = accepted(Version::V5, &[]);
    let mut out = Vec::new();
    let mut send = |session: &mut Session, topic: &str| {
        out.clear();
        session
            .publish(topic, b"", &PublishOptions::CONFIRMED, &mut out)
            .unwrap();
        (
            out[0] >> 1 & 3,
            out.get(3 + topic.len() + 1..).map(<[u8]>::to_vec),
        )
    };
    // The first on each topic has QoS 1.
    let (qos, id) = send(&mut session, "a");
    assert_eq!(qos, 1);
    let (qos, other) = send(&mut session, "b");
    assert_eq!(qos, 1);
    assert_eq!(send(&mut session, "a").0, 0);
    let mut answers = Vec::new();
    // Not authorized; a quota that is used up may be free another time.
    for (id, code) in [(id, 0x87), (other, 0x97)] {
        let id = id.unwrap();
        let puback = [0x40, 4, id[0], id[1], code, 0];
        session.receive(&puback, &mut Vec::new(), &mut |it| answers.push(it));
    }
    assert!(
        matches!(&answers[..], [Received::Denied(topic, _)] if topic == "a"),
        "{answers:?}"
    );
}

#[test]
fn no_more_answers_are_awaited_than_the_broker_gives_at_the_same_time() {
    for (most, expected) in [(1, 0), (6, 3), (1000, MOST_AWAITED)] {
        // Property 33, receive maximum.
        let [high, low] = u16::to_be_bytes(most);
        let mut session = accepted(Version::V5, &[33, high, low]);
        let mut out = Vec::new();
        for topic in 0..100 {
            let topic = format!("topic/{topic}");
            session
                .publish(&topic, b"", &PublishOptions::CONFIRMED, &mut out)
                .unwrap();
        }
        assert_eq!(session.unacknowledged.len(), expected);
    }
}

#[test]
fn what_is_malformed_ends_the_connection_and_nothing_after_it_counts() {
    let plain = [0x30, 4, 0, 1, b't', 0];
    for version in VERSIONS {
        for bad in [
            &[0x30, 0xff, 0xff, 0xff, 0xff, 1][..], // no length
            &[0x30, 3, 0, 9, b't'],                 // a topic longer than its packet
            &[0x36, 5, 0, 1, b't', 0, 0],           // QoS 3
            &[0x30, 5, 0, 2, b't', 0xff, 0],        // a topic that is not valid UTF-8
            &[0x30, 7, 0, 1, b't', 9, 9, 0, 1],     // properties longer than their packet
        ] {
            if version == Version::V3 && bad[1] == 7 {
                continue; // no properties there
            }
            let mut session = accepted(version, &[]);
            let mut events = Vec::new();
            session.receive(
                &[&plain, bad, &plain].concat(),
                &mut Vec::new(),
                &mut |it| {
                    events.push(it);
                },
            );
            assert!(matches!(events[0], Received::Publish(_)), "{events:?}");
            assert!(events.len() > 1, "{version:?} {bad:?}");
            let closed = |event: &Received| matches!(event, Received::Closed(_));
            assert!(
                events[1..].iter().all(closed),
                "{version:?} {bad:?} {events:?}"
            );
        }
    }
}

#[test]
fn the_highest_quality_of_service_that_the_broker_takes_is_kept_to() {
    let sent = |properties: &[u8]| {
        let mut session = accepted(Version::V5, properties);
        let mut out = Vec::new();
        let options = PublishOptions {
            qos: QoS::AtLeastOnce,
            retain: true,
            ..PublishOptions::default()
        };
        session.publish("t", b"x", &options, &mut out).unwrap();
        // QoS in bits 1 and 2, retained in bit 0.
        out[0] & 0b0000_0111
    };
    assert_eq!(sent(&[]), 0b011);
    // Properties 36, maximum QoS, and 37, retain available.
    assert_eq!(sent(&[36, 1]), 0b011);
    assert_eq!(sent(&[36, 0]), 0b001);
    assert_eq!(sent(&[36, 0, 37, 0]), 0b000);
    assert_eq!(sent(&[37, 0]), 0b010);
}

#[test]
fn a_silent_broker_is_asked_and_given_up_within_the_keep_alive_interval() {
    for version in VERSIONS {
        let mut session = accepted(version, &[]);
        let start = Instant::now();
        let mut pings = 0;
        let mut closed = None;
        let second = Duration::from_secs(1);
        for passed in 0..60u32 {
            let now = start + second * passed;
            // Messages for 20 s, and answers to pings: none is given up. What it sends itself is no answer.
            if passed < 20 {
                session.receive(&[0xd0, 0], &mut Vec::new(), &mut |_| {});
            }
            let mut out = Vec::new();
            session
                .publish("t", b"x", &PublishOptions::default(), &mut out)
                .unwrap();
            out.clear();
            session.tick(now, &mut out, &mut |received| {
                closed = Some((passed, format!("{received:?}")));
            });
            pings += out.windows(2).filter(|bytes| *bytes == PINGREQ).count();
            if closed.is_some() {
                break;
            }
        }
        let (passed, reason) = closed.unwrap();
        assert!((35..=50).contains(&passed), "{passed}");
        assert!(
            reason.contains("has not answered a ping for 15 s"),
            "{reason}"
        );
        assert!(pings > 0);
    }
}
