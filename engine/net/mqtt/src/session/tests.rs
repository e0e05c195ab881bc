use super::*;
use proptest::prelude::*;
use swarmwright_fuzzing::{config, mutated, noise, packets_of_brokers, peak};

use crate::dialect::{Dialect, Remedy};
use crate::settings::Settings;

const VERSIONS: [Version; 2] = [Version::Five, Version::Three];

/// Creates a session that the broker has accepted, with `properties` (MQTT 5) in its CONNACK.
fn accepted(version: Version, properties: &[u8]) -> Session {
    let mut session = Session::new(version, 30);
    let settings = Settings::new("mqtt://localhost".parse().unwrap());
    let dialect = Dialect::first(Some(version));
    session
        .connect(&settings, "me", dialect, &mut Vec::new())
        .unwrap();
    let mut connack = vec![0x20, 2, 0, 0];
    if version == Version::Five {
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

/// Returns the visible parts of the received messages.
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

/// Creates random options.
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
fn messages_are_the_same_wherever_the_stream_is_cut() {
    let mut random = fastrand::Rng::with_seed(7);
    for version in VERSIONS {
        let mut stream = Vec::new();
        let mut expected = Vec::new();
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
            // Often the same topic as before.
            let topic = format!("topic/{}", number / 7 % 5);
            let mut packet = Vec::new();
            sender
                .publish(&topic, &payload, &options, &mut packet)
                .unwrap();
            // Exclude the ping that follows a large packet.
            let (_, header, length) = frame(&packet, usize::MAX).unwrap().unwrap();
            stream.extend_from_slice(&packet[..header + length]);
            expected.push((topic, payload, options.retain));
        }
        assert_eq!(messages(&mut accepted(version, &[]), &[&stream]), expected);
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
    let mut session = accepted(Version::Five, &[]);
    for options in bad {
        let mut out = Vec::new();
        assert!(session.publish("t", b"", &options, &mut out).is_err());
        assert!(out.is_empty());
    }
}

#[test]
fn a_message_larger_than_the_broker_takes_is_refused() {
    // Property 39, maximum packet size: 100.
    let mut session = accepted(Version::Five, &[39, 0, 0, 0, 100]);
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
    let mut session = accepted(Version::Five, &[]);
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
    // The first message on each topic has QoS 1.
    let (qos, id) = send(&mut session, "a");
    assert_eq!(qos, 1);
    let (qos, other) = send(&mut session, "b");
    assert_eq!(qos, 1);
    assert_eq!(send(&mut session, "a").0, 0);
    let mut answers = Vec::new();
    // Not authorized; or an exhausted quota, which is temporary.
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
        let mut session = accepted(Version::Five, &[33, high, low]);
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
        for (bad, code, words) in [
            (&[0x30, 0xff, 0xff, 0xff, 0xff, 1][..], 0x81, "length"),
            (&[0x30, 3, 0, 9, b't'], 0x81, "middle of a field"),
            (&[0x36, 5, 0, 1, b't', 0, 0], 0x81, "QoS 3"),
            (&[0x34, 6, 0, 1, b't', 0, 1, 0], 0x82, "QoS 2"),
            (&[0x32, 6, 0, 1, b't', 0, 0, 0], 0x82, "packet identifier 0"),
            (&[0x30, 5, 0, 2, b't', 0xff, 0], 0x81, "not UTF-8"),
            (&[0x30, 5, 0, 2, b't', 0, 0], 0x81, "U+0000"),
            (&[0x30, 5, 0, 2, b't', b'#', 0], 0x82, "a topic"),
            (&[0x30, 3, 0, 0, 0], 0x82, "a topic"),
            (
                &[0x30, 7, 0, 1, b't', 9, 9, 0, 1],
                0x81,
                "middle of a field",
            ),
            (&[0x30, 7, 0, 1, b't', 3, 0x23, 0, 1], 0x94, "topic alias"),
            (&[0x30, 0xff, 0xff, 0xff, 0x7f], 0x95, "larger than"),
            (&[0x31, 0], 0x81, "middle of a field"),
            (&[0xd1, 0], 0x81, "flags"),
            (&[0xd0, 1, 0], 0x81, "longer than its fields"),
            (&[0x20, 3, 0, 0, 0], 0x82, "second CONNACK"),
            (&[0x40, 2, 0, 1], 0x82, "PUBACK"),
            (&[0x50, 2, 0, 1], 0x82, "QoS 2"),
            (&[0x62, 2, 0, 1], 0x82, "QoS 2"),
            (&[0x90, 4, 0, 1, 0, 0], 0x82, "SUBACK"),
            (&[0xb0, 4, 0, 1, 0, 0], 0x82, "UNSUBACK"),
            (&[0xc0, 0], 0x82, "do not send"),
            (&[0xf0, 0], 0x82, "AUTH"),
            (&[0x00, 0], 0x82, "do not send"),
        ] {
            let only_five = ["topic alias", "larger than", "AUTH", "second CONNACK"];
            if version == Version::Three && (bad[1] == 7 || only_five.contains(&words)) {
                continue;
            }
            let mut session = accepted(version, &[]);
            let (mut events, mut out) = (Vec::new(), Vec::new());
            session.receive(&[&plain, bad, &plain].concat(), &mut out, &mut |it| {
                events.push(it);
            });
            assert!(
                matches!(&events[..], [Received::Publish(_), Received::Closed(reason)] if reason.contains(words)),
                "{version:?} {bad:?} {events:?}"
            );
            // In MQTT 5, the broker receives the reason.
            match version {
                Version::Five => assert_eq!((out[0], out[2]), (0xe0, code), "{bad:?} {out:?}"),
                Version::Three => assert!(out.is_empty()),
            }
        }
    }
}

#[test]
fn the_highest_quality_of_service_that_the_broker_takes_is_kept_to() {
    let sent = |properties: &[u8]| {
        let mut session = accepted(Version::Five, properties);
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
            // Messages for 20 s, and answers to pings: the broker is not given up. What the client sends is no answer.
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

/// Returns the event of a new session for an answer to its CONNECT.
fn answer(version: Version, connack: &[u8]) -> Received {
    let mut session = Session::new(version, 30);
    let mut answers = Vec::new();
    session.receive(connack, &mut Vec::new(), &mut |it| answers.push(it));
    assert_eq!(answers.len(), 1, "{answers:?}");
    answers.remove(0)
}

#[test]
fn a_refusal_is_given_in_words_with_what_may_help() {
    let reason = b"try \x1b[2J\"later\"";
    let with_text = [&[0x20, 21, 0, 0x89, 18, 0x1f, 0, 15][..], reason].concat();
    for (version, connack, words, remedy) in [
        (
            Version::Five,
            &[0x20, 3, 0, 0x84, 0][..],
            "unsupported protocol version",
            Remedy::Older,
        ),
        // Answer of brokers that support only MQTT 3.
        (
            Version::Five,
            &[0x20, 2, 0, 1],
            "unsupported protocol version",
            Remedy::Older,
        ),
        (
            Version::Five,
            &[0x20, 3, 0, 0x87, 0],
            "not authorized",
            Remedy::None,
        ),
        (
            Version::Five,
            &[0x20, 3, 0, 0x9b, 0],
            "QoS not supported",
            Remedy::WillAtMostOnce,
        ),
        (
            Version::Five,
            &[0x20, 3, 0, 0x9a, 0],
            "retain not supported",
            Remedy::WillNotRetained,
        ),
        (
            Version::Five,
            &[0x20, 3, 0, 0xfe, 0],
            "reason code 0xfe",
            Remedy::None,
        ),
        (
            Version::Five,
            &with_text,
            "server busy: try \\u{1b}[2J\"later\"",
            Remedy::Retry,
        ),
        (
            Version::Three,
            &[0x20, 2, 0, 3],
            "server unavailable",
            Remedy::Retry,
        ),
        (
            Version::Three,
            &[0x20, 2, 0, 5],
            "not authorized",
            Remedy::None,
        ),
    ] {
        match answer(version, connack) {
            Received::Refused(reason, found) => {
                assert_eq!((reason.as_str(), found), (words, remedy));
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn what_comes_instead_of_the_answer_to_connect_ends_the_connection() {
    for (version, bytes, words) in [
        (
            Version::Five,
            &[0x30, 4, 0, 1, b't', 0][..],
            "not a CONNACK",
        ),
        (Version::Three, &[0x30, 3, 0, 1, b't'], "not a CONNACK"),
        (Version::Five, &[0xd0, 0], "not a CONNACK"),
        (Version::Five, &[0xe0, 1, 0x8b], "server shutting down"),
        (Version::Five, &[0x20, 2, 0, 0], "middle of a field"),
        (Version::Five, &[0x20, 3, 2, 0, 0], "flags in CONNACK"),
        (Version::Five, &[0x20, 3, 0, 1, 0], "reason code in CONNACK"),
        (Version::Three, &[0x20, 2, 0, 6], "return code in CONNACK"),
        (
            Version::Five,
            &[0x20, 6, 0, 0, 3, 0x21, 0, 0],
            "receive maximum of 0",
        ),
        (
            Version::Five,
            &[0x20, 5, 0, 0, 2, 0x24, 2],
            "neither 0 nor 1",
        ),
        (
            Version::Five,
            &[0x20, 7, 0, 0, 4, 0x24, 1, 0x24, 1],
            "occurs twice",
        ),
        (
            Version::Five,
            b"HTTP/1.1 400 Bad Request\r\n\r\n",
            "not a CONNACK",
        ),
    ] {
        match answer(version, bytes) {
            Received::Closed(reason) => assert!(reason.contains(words), "{bytes:?} {reason}"),
            other => panic!("{bytes:?} {other:?}"),
        }
    }
}

#[test]
fn a_subscription_is_answered_by_as_many_codes_as_it_has_filters() {
    let subscription = |filter: &str| Subscription {
        filter: filter.into(),
        qos: QoS::AtLeastOnce,
    };
    let subscriptions = [subscription("a/+"), subscription("b")];
    for version in VERSIONS {
        let three = version == Version::Three;
        for (codes, fits) in [
            (&[1, 0][..], true),
            (&[0, 0x80], true),
            (&[1], false),
            (&[1; 3], false),
        ] {
            let mut session = accepted(version, &[]);
            let mut out = Vec::new();
            session.subscribe(&subscriptions, &mut out).unwrap();
            let options = if three { 1 } else { 1 | 4 };
            assert_eq!((out[0], out[out.len() - 1]), (0x82, options));
            let mut suback = vec![0x90, 3, out[2], out[3], 0];
            suback.truncate(if three { 4 } else { 5 });
            suback.extend(codes);
            suback[1] = u8::try_from(suback.len()).unwrap() - 2;
            let mut events = Vec::new();
            session.receive(&suback, &mut Vec::new(), &mut |it| events.push(it));
            match &events[..] {
                [Received::Subscribed(granted)] if fits => {
                    let refused = Granted::No("unspecified error".to_owned());
                    assert_eq!(granted[0], Granted::Yes);
                    assert_eq!(granted[1] == refused, codes[1] == 0x80, "{granted:?}");
                }
                [Received::Closed(_)] if !fits => {}
                other => panic!("{codes:?} {other:?}"),
            }
        }
    }
}

#[test]
fn messages_that_must_be_acknowledged_are_and_others_are_not() {
    for version in VERSIONS {
        let mut session = accepted(version, &[]);
        let mut out = Vec::new();
        let properties: &[u8] = if version == Version::Five { &[0] } else { &[] };
        for (flags, id) in [(0x30, &[][..]), (0x32, &[1, 2]), (0x3b, &[3, 4])] {
            let body = [b"\0\x01t", id, properties].concat();
            let packet = [&[flags, u8::try_from(body.len()).unwrap()], &body[..]].concat();
            session.receive(&packet, &mut out, &mut |it| {
                assert!(matches!(it, Received::Publish(_)))
            });
        }
        assert_eq!(out, [0x40, 2, 1, 2, 0x40, 2, 3, 4]);
    }
}

#[test]
fn what_the_broker_does_not_take_acknowledged_is_sent_at_qos_0() {
    // Property 33, receive maximum.
    let mut session = accepted(Version::Five, &[33, 0, 2]);
    let qos_1 = PublishOptions {
        qos: QoS::AtLeastOnce,
        ..PublishOptions::default()
    };
    let send = |session: &mut Session| {
        let mut out = Vec::new();
        session.publish("t", b"", &qos_1, &mut out).unwrap();
        out
    };
    let first = send(&mut session);
    assert_eq!((first[0], &first[5..7]), (0x32, &[0, 1][..]));
    assert_eq!(send(&mut session)[0], 0x32);
    assert_eq!(send(&mut session)[0], 0x30);
    session.receive(&[0x40, 2, 0, 1], &mut Vec::new(), &mut |it| {
        panic!("{it:?}")
    });
    assert_eq!(send(&mut session)[0], 0x32);
    assert_eq!(send(&mut session)[0], 0x30);
}

#[test]
fn packet_identifiers_in_use_are_not_given_again() {
    let mut session = accepted(Version::Five, &[]);
    let mut out = Vec::new();
    let qos_1 = PublishOptions {
        qos: QoS::AtLeastOnce,
        ..PublishOptions::default()
    };
    session.publish("kept", b"", &qos_1, &mut out).unwrap();
    for _ in 0..70_000u32 {
        out.clear();
        session.publish("t", b"", &qos_1, &mut out).unwrap();
        let id = [out[5], out[6]];
        assert!(id != [0, 0] && id != [0, 1]);
        session.receive(&[0x40, 2, id[0], id[1]], &mut Vec::new(), &mut |_| {});
    }
    assert_eq!(session.unacknowledged.len(), 1);
}

#[test]
fn the_keep_alive_interval_of_the_broker_is_kept() {
    let pings = |properties: &[u8]| {
        let mut session = accepted(Version::Five, properties);
        let start = Instant::now();
        let mut pings = Vec::new();
        for passed in 0..100u32 {
            // The broker is never silent, so only its own interval counts.
            session.receive(&[0xd0, 0], &mut Vec::new(), &mut |_| {});
            let mut out = Vec::new();
            let now = start + Duration::from_secs(passed.into()) + Duration::from_millis(500);
            session.tick(now, &mut out, &mut |it| panic!("{it:?}"));
            if out == PINGREQ {
                pings.push(passed);
            }
        }
        pings
    };
    assert_eq!(pings(&[]), [30, 60, 90]);
    // Property 19, server keep alive.
    assert_eq!(pings(&[19, 0, 40]), [40, 80]);
    assert_eq!(pings(&[19, 0, 0]), []);
}

/// Passes bytes to a session and checks its events and its memory.
fn listen(version: Version, bytes: &[u8], is_accepted: bool) {
    let run = || {
        let mut session = if is_accepted {
            accepted(version, &[])
        } else {
            Session::new(version, 30)
        };
        let (mut out, mut over, mut length) = (Vec::new(), false, 0);
        for piece in bytes.chunks(7) {
            session.receive(piece, &mut out, &mut |received| {
                assert!(!over, "{received:?} after the end");
                match received {
                    Received::Publish(message) => {
                        assert!(topic::is_name(message.topic()));
                        length += message.payload().len() + message.topic().len();
                    }
                    Received::Closed(reason) => {
                        assert!(!reason.is_empty());
                        over = true;
                    }
                    Received::Refused(..) => over = true,
                    Received::Accepted | Received::Denied(..) | Received::Subscribed(_) => {}
                }
            });
        }
        assert!(length <= bytes.len() && out.len() <= 4 * bytes.len() + 100);
    };
    let ((), held) = peak(run);
    assert!(held <= 8 * bytes.len() + 8000, "{held} of {}", bytes.len());
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn fuzz_a_broker_that_is_nearly_right(bytes in mutated(packets_of_brokers()), is_accepted: bool) {
        for version in VERSIONS {
            listen(version, &bytes, is_accepted);
        }
    }

    #[test]
    fn fuzz_a_broker_that_is_none(bytes in noise(), is_accepted: bool) {
        for version in VERSIONS {
            listen(version, &bytes, is_accepted);
        }
    }
}
