//! Each side decodes the packets that the other one encodes.

use super::*;
use proptest::option;
use proptest::prelude::*;

fn version() -> impl Strategy<Value = Version> {
    prop_oneof![Just(Version::Three), Just(Version::Five)]
}

/// Generates texts whose lengths cover all sizes of a length field.
fn text() -> impl Strategy<Value = String> {
    prop_oneof![
        4 => "[a-zä漢/ ]{0,20}",
        1 => (0..300usize).prop_map(|length| "x".repeat(length)),
        1 => Just("y".repeat(65_535)),
    ]
}

fn topic_name() -> impl Strategy<Value = String> {
    text().prop_map(|text| text + "/t").prop_map(|mut text| {
        if text.len() > 65_535 {
            text.drain(..text.len() - 65_535);
        }
        text
    })
}

fn bytes() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        4 => prop::collection::vec(any::<u8>(), 0..200),
        1 => (16_000..70_000usize).prop_map(|length| vec![7; length]),
    ]
}

/// Generates data that fits a two-byte length.
fn binary() -> impl Strategy<Value = Vec<u8>> {
    bytes().prop_map(|mut bytes| {
        bytes.truncate(65_535);
        bytes
    })
}

type Drawn = (Option<u32>, Option<String>, Option<String>, Option<Vec<u8>>);

fn properties() -> impl Strategy<Value = Drawn> {
    (
        option::of(any::<u32>()),
        option::of(text()),
        option::of(topic_name()),
        option::of(binary()),
    )
}

fn encoded((expiry, content_type, response_topic, correlation): &Drawn) -> Vec<u8> {
    let properties = client::Properties {
        expiry: *expiry,
        content_type: content_type.as_deref(),
        response_topic: response_topic.as_deref(),
        correlation: correlation.as_deref(),
    };
    let encoded = properties.encoded().unwrap();
    assert_eq!(expiry_of(&encoded), *expiry);
    encoded
}

proptest! {
    #[test]
    fn connect(
        (version, client_id, clean, keep_alive) in (version(), text(), any::<bool>(), any::<u16>()),
        (session_expiry, receive_maximum, maximum_packet) in (any::<u32>(), 1u16.., 1u32..),
        will in option::of((topic_name(), binary(), properties(), 0u8..3, any::<bool>(), any::<u32>())),
        (user, password) in (option::of(text()), option::of(binary())),
    ) {
        let five = version == Version::Five;
        // MQTT 3 cannot express this.
        let expiry = if five { session_expiry } else if clean { 0 } else { u32::MAX };
        let will = will.as_ref().map(|(topic, payload, properties, qos, retain, delay)| Will {
            topic,
            payload,
            properties: if five { encoded(properties) } else { Vec::new() },
            qos: *qos,
            retain: *retain,
            delay: if five { *delay } else { 0 },
        });
        let password = password.filter(|_| five || user.is_some());
        let packet = Connect {
            version,
            client_id: &client_id,
            clean,
            keep_alive,
            session_expiry: expiry,
            receive_maximum: if five { receive_maximum } else { u16::MAX },
            maximum_packet: if five { maximum_packet } else { u32::MAX },
            will,
            user: user.as_deref(),
            password: password.as_deref(),
        };
        let mut out = Vec::new();
        client::connect(&mut out, &packet).unwrap();
        prop_assert_eq!(version_of(only(&out).1), Some(version));
        prop_assert_eq!(by_broker(&out, version), Ok(Packet::Connect(packet)));
    }

    #[test]
    fn publish_in_both_directions(
        (version, topic, payload) in (version(), topic_name(), bytes()),
        (drawn, qos, retain, id) in (properties(), 0u8..3, any::<bool>(), 1u16..),
    ) {
        let properties = if version == Version::Five { encoded(&drawn) } else { Vec::new() };
        let id = if qos > 0 { id } else { 0 };
        let outgoing = Outgoing {
            topic: &topic, payload: &payload, properties: &properties, expiry: None, identifiers: &[], qos, retain, again: false, id,
        };
        let expected = Publish { topic: &topic, payload: &payload, properties: &properties, qos, retain, id };
        let mut out = vec![1, 2, 3];
        client::publish(&mut out, &outgoing, version, usize::MAX).unwrap();
        let out = &out[3..];
        prop_assert_eq!(by_broker(out, version), Ok(Packet::Publish(expected)));
        let mut sent = Vec::new();
        publish(&mut sent, &outgoing, version);
        prop_assert_eq!(&sent, out);
        if qos < 2 {
            prop_assert_eq!(by_client(out, version), Ok(client::Packet::Publish(expected)));
        } else {
            prop_assert!(by_client(out, version).is_err());
        }
        let (first, body) = only(out);
        let bare = client::bare(first, body, version);
        let is_bare = qos == 0 && properties.is_empty();
        prop_assert_eq!(bare, is_bare.then_some((topic.as_bytes(), &payload[..])));
        // The limit is exact.
        let mut none = Vec::new();
        prop_assert!(client::publish(&mut none, &outgoing, version, out.len()).is_ok());
        none.clear();
        prop_assert!(client::publish(&mut none, &outgoing, version, out.len() - 1).is_err());
        prop_assert!(none.is_empty());
    }

    #[test]
    fn publish_with_what_a_broker_adds(
        (topic, payload, expiry) in (topic_name(), bytes(), option::of(any::<u32>())),
        identifiers in prop::collection::vec(1u32..=268_435_455, 0..4),
    ) {
        let outgoing = Outgoing {
            topic: &topic, payload: &payload, properties: &[], expiry, identifiers: &identifiers, qos: 1, retain: false, again: true, id: 7,
        };
        let mut out = Vec::new();
        publish(&mut out, &outgoing, Version::Five);
        match by_client(&out, Version::Five) {
            Ok(client::Packet::Publish(message)) => {
                prop_assert_eq!(message.topic, &topic);
                prop_assert_eq!(message.payload, &payload);
                prop_assert_eq!(expiry_of(message.properties), expiry);
            }
            other => prop_assert!(false, "{:?}", other),
        }
    }

    #[test]
    fn subscribe(
        (version, id) in (version(), 1u16..),
        drawn in prop::collection::vec((text(), 0u8..3, any::<(bool, bool)>(), 0u8..3), 1..5),
    ) {
        let five = version == Version::Five;
        let filters: Vec<String> = drawn.iter().map(|(text, ..)| format!("+/{:.65000}/#", text.replace('\0', ""))).collect();
        let filters: Vec<Filter<'_>> = filters.iter().zip(&drawn).map(|(filter, (_, qos, (no_local, as_published), handling))| Filter {
            filter,
            qos: *qos,
            no_local: five && *no_local,
            retain_as_published: five && *as_published,
            retain_handling: if five { *handling } else { 0 },
        }).collect();
        let mut out = Vec::new();
        client::subscribe(&mut out, id, &filters, version).unwrap();
        prop_assert_eq!(by_broker(&out, version), Ok(Packet::Subscribe { id, identifier: None, filters }));
    }

    #[test]
    fn answers(version in version(), id in 1u16.., codes in prop::collection::vec(prop_oneof![0u8..3, 0x80u8..], 0..300), what in "[ -~]{0,200}") {
        let five = version == Version::Five;
        let mut out = Vec::new();
        suback(&mut out, id, &codes, version);
        let expected: Vec<u8> = codes.iter().map(|&code| if five { code } else { code.min(0x80) }).collect();
        prop_assert_eq!(by_client(&out, version), Ok(client::Packet::Suback { id, codes: &expected, text: None }));
        for code in [0, 0x10, 0x87] {
            out.clear();
            acknowledge(&mut out, Answer::Acknowledged, id, code, version);
            let code = if five { code } else { 0 };
            prop_assert_eq!(by_client(&out, version), Ok(client::Packet::Puback { id, code, text: None }));
            prop_assert_eq!(by_broker(&out, version), Ok(Packet::Acknowledge(Answer::Acknowledged, id, code)));
        }
        out.clear();
        disconnect(&mut out, reason::BUSY, &what, version, usize::MAX);
        let text = Some(what.as_str()).filter(|what| !what.is_empty());
        if five {
            prop_assert_eq!(by_client(&out, version), Ok(client::Packet::Disconnect { code: reason::BUSY, text }));
            prop_assert_eq!(by_broker(&out, version), Ok(Packet::Disconnect { reason: reason::BUSY, session_expiry: None }));
        } else {
            prop_assert!(out.is_empty());
        }
    }

    #[test]
    fn connack_of_a_client_that_is_accepted(
        (version, present, receive_maximum, maximum_packet) in (version(), any::<bool>(), 1u16.., 1u32..),
        (assigned_id, session_expiry) in (option::of(text()), option::of(any::<u32>())),
    ) {
        let welcome = Welcome { assigned_id: assigned_id.as_deref(), session_expiry, receive_maximum, maximum_packet };
        let out = connack(version, present, &welcome);
        let five = version == Version::Five;
        prop_assert_eq!(by_client(&out, version), Ok(client::Packet::Connack(client::Connack {
            code: 0,
            text: None,
            present,
            keep_alive: None,
            receive_maximum: if five { receive_maximum } else { u16::MAX },
            maximum_packet: if five { maximum_packet } else { u32::MAX },
            maximum_qos: 2,
            retains: true,
        })));
    }
}

#[test]
fn pings_and_ends() {
    for version in [Version::Three, Version::Five] {
        assert_eq!(by_broker(&client::PINGREQ, version), Ok(Packet::Ping));
        let end = Packet::Disconnect {
            reason: reason::SUCCESS,
            session_expiry: None,
        };
        assert_eq!(by_broker(&client::DISCONNECT, version), Ok(end));
        let mut out = Vec::new();
        pingresp(&mut out);
        assert_eq!(by_client(&out, version), Ok(client::Packet::Pong));
    }
}

#[test]
fn refusals_of_connections_keep_their_reasons() {
    for code in 0x80..=0xff {
        let mut out = Vec::new();
        refuse(&mut out, code, "why", Version::Five, 100);
        match by_client(&out, Version::Five) {
            Ok(client::Packet::Connack(connack)) => {
                assert_eq!((connack.code, connack.text), (code, Some("why")));
            }
            other => panic!("{other:?}"),
        }
        // MQTT 3 has five codes, and none for a CONNECT that violates the protocol.
        out.clear();
        refuse(&mut out, code, "why", Version::Three, 100);
        if matches!(code, reason::MALFORMED | reason::PROTOCOL_ERROR) {
            assert!(out.is_empty());
            continue;
        }
        let expected = match code {
            reason::UNSUPPORTED_VERSION
            | reason::BAD_CLIENT_ID
            | reason::BAD_PASSWORD
            | reason::NOT_AUTHORIZED => code,
            _ => reason::UNAVAILABLE,
        };
        match by_client(&out, Version::Three) {
            Ok(client::Packet::Connack(connack)) => assert_eq!(connack.code, expected),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn what_cannot_be_sent_is_named_and_nothing_is_written() {
    let long = "x".repeat(65_536);
    let will = |topic, payload| Will {
        topic,
        payload,
        properties: Vec::new(),
        qos: 0,
        retain: false,
        delay: 0,
    };
    let base = |client_id, user, password, will| Connect {
        version: Version::Five,
        client_id,
        clean: true,
        keep_alive: 1,
        session_expiry: 0,
        receive_maximum: u16::MAX,
        maximum_packet: u32::MAX,
        will,
        user,
        password,
    };
    let mut out = Vec::new();
    for (packet, words) in [
        (
            base("a\0", None, None, None),
            "the client identifier contains",
        ),
        (base("a", Some("\0"), None, None), "the user name contains"),
        (
            base("a", Some(long.as_str()), None, None),
            "the user name is longer than 65,535 bytes",
        ),
        (
            base("a", None, Some(long.as_bytes()), None),
            "the password is longer",
        ),
        (
            base("a", None, None, Some(will("a/+", b""))),
            "the topic of the last will is empty or has wildcards",
        ),
        (
            base("a", None, None, Some(will("a", long.as_bytes()))),
            "the message of the last will is longer",
        ),
    ] {
        let said = client::connect(&mut out, &packet).unwrap_err().to_string();
        assert!(said.starts_with(words), "{said}");
    }
    let filter = |filter| Filter {
        filter,
        qos: 0,
        no_local: false,
        retain_as_published: false,
        retain_handling: 0,
    };
    for filters in [
        &[][..],
        &[filter("a"), filter("a#")],
        &[filter("")],
        &[filter("\0")],
        &[filter(&long)],
    ] {
        client::subscribe(&mut out, 1, filters, Version::Five).unwrap_err();
    }
    for topic in ["", "a/#", "+", "a\0", &long] {
        let message = Outgoing {
            topic,
            payload: b"",
            properties: &[],
            expiry: None,
            identifiers: &[],
            qos: 0,
            retain: false,
            again: false,
            id: 0,
        };
        client::publish(&mut out, &message, Version::Three, usize::MAX).unwrap_err();
    }
    assert!(out.is_empty());
    let nothing = client::Properties::default();
    for properties in [
        client::Properties {
            response_topic: Some("a/+"),
            ..nothing
        },
        client::Properties {
            content_type: Some("\0"),
            ..nothing
        },
        client::Properties {
            content_type: Some(&long),
            ..nothing
        },
        client::Properties {
            correlation: Some(long.as_bytes()),
            ..nothing
        },
    ] {
        properties.encoded().unwrap_err();
    }
}

#[test]
fn each_packet_of_the_corpora_is_right_in_a_version() {
    let versions = [Version::Three, Version::Five];
    for packet in swarmwright_fuzzing::packets_of_clients() {
        assert!(
            versions
                .iter()
                .any(|version| by_broker(&packet, *version).is_ok()),
            "{packet:02x?}"
        );
    }
    for packet in swarmwright_fuzzing::packets_of_brokers() {
        assert!(
            versions
                .iter()
                .any(|version| by_client(&packet, *version).is_ok()),
            "{packet:02x?}"
        );
    }
}
