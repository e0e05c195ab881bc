//! Packets that violate the standards, as bytes, and the answers that the standards require.

use super::*;

/// Encodes a CONNECT of MQTT 5 with these properties.
fn connect_with(properties: &[u8], id: &[u8]) -> Vec<u8> {
    let mut body = [&text("MQTT")[..], &[5, 2, 0, 10, properties.len() as u8]].concat();
    body.extend(properties);
    body.extend((id.len() as u16).to_be_bytes());
    body.extend(id);
    packet(0x10, &body)
}

/// Encodes a CONNECT of MQTT 3.1.1.
fn connect_three(flags: u8, rest: &[u8]) -> Vec<u8> {
    packet(
        0x10,
        &[&text("MQTT")[..], &[4, flags, 0, 10], &text("p"), rest].concat(),
    )
}

/// Returns the answer to a new connection, in whole packets; checks that the connection is closed if `is_closed`.
fn answer(stage: &mut Stage, bytes: &[u8], is_closed: bool) -> Vec<u8> {
    let link = stage.hub.open("test".into(), stage.now).unwrap();
    stage.hub.receive(link, bytes, stage.now);
    assert_eq!(stage.hub.is_closing(link), is_closed, "{bytes:02x?}");
    stage.hub.outbox(link).pending().to_vec()
}

#[test]
fn a_connect_is_refused_in_its_own_version() {
    let mut stage = Stage::new(Limits::default());
    let method = [&[0x15][..], &text("unsupported"), &[0x16], &text("test")].concat();
    for (bytes, code) in [
        (
            connect_with(&method, b"p"),
            reason::BAD_AUTHENTICATION_METHOD,
        ),
        (connect_with(&[], b"top\0\0"), reason::MALFORMED),
        (connect_with(&[], b"\xff"), reason::MALFORMED),
        (connect_with(&[0x21, 0, 0], b"p"), reason::PROTOCOL_ERROR),
        (connect_with(&[0x99], b"p"), reason::MALFORMED),
    ] {
        assert_eq!(answer(&mut stage, &bytes, true), [0x20, 3, 0, code, 0]);
    }
    // MQTT 3.1.1 has no code for a CONNECT that violates the protocol, so the connection is closed.
    for bytes in [
        connect_three(0x42, &text("password without a user")),
        connect_three(0x02, b"more"),
        connect_three(0x03, &[]),
        packet(0x10, &text("HTTP")),
        packet(0xc0, &[]),
    ] {
        assert_eq!(answer(&mut stage, &bytes, true), [], "{bytes:02x?}");
    }
    let old = packet(
        0x10,
        &[&text("MQTT")[..], &[6, 2, 0, 10], &text("p")].concat(),
    );
    assert_eq!(answer(&mut stage, &old, true), [0x20, 2, 0, 1]);
    let bytes = [&text("MQIsdp")[..], &[3, 3, 0, 10], &text("p")].concat();
    assert_eq!(
        answer(&mut stage, &packet(0x10, &bytes), false),
        [0x20, 2, 0, 0]
    );
    let both = [text("user"), text("password")].concat();
    assert_eq!(
        answer(&mut stage, &connect_three(0xc2, &both), false),
        [0x20, 2, 0, 0]
    );
}

/// MQTT 5.0, 3.1.2.11.4, 3.2.2.3.9 and 3.14.2.2.3.
#[test]
fn no_packet_is_larger_than_its_client_accepts() {
    for maximum in [15u8, 20, 60, 100] {
        let mut stage = Stage::new(Limits::default());
        let (link, _) = stage.join(&connect_with(&[0x27, 0, 0, 0, maximum], b"p"));
        stage.say(link, &subscribe("aa", 3));
        let sent = stage.hub.outbox(link).pending().len();
        let whole = 7 + "unknown subscription options".len();
        let expected = if usize::from(maximum) < whole {
            4
        } else {
            whole
        };
        assert_eq!(sent, expected, "at most {maximum}");
        let heard = stage.heard(link);
        assert_eq!((heard[0].0, heard[0].1[0]), (DISCONNECT, reason::MALFORMED));
    }
    // An answer that cannot be omitted ends the connection.
    let mut stage = Stage::new(Limits::default());
    let (link, _) = stage.join(&connect_with(&[0x27, 0, 0, 0, 16], b"p"));
    let mut body = vec![0, 7, 0];
    for _ in 0..20 {
        body.extend(text("a"));
        body.push(0);
    }
    stage.say(link, &packet(0x82, &body));
    assert_eq!(
        stage.heard(link),
        [(DISCONNECT, vec![reason::PACKET_TOO_LARGE, 0])]
    );
    let bytes = connect_with(&[0x27, 0, 0, 0, 14], b"p");
    let refused = [0x20, 3, 0, reason::PACKET_TOO_LARGE, 0];
    assert_eq!(answer(&mut stage, &bytes, true), refused);
    let tiny = connect_with(&[0x27, 0, 0, 0, 4], b"p");
    assert_eq!(answer(&mut stage, &tiny, true), []);
}

#[test]
fn packets_with_empty_filters_or_more_than_their_fields_are_malformed() {
    let empty = [&[0, 7, 0][..], &text("")].concat();
    for bytes in [
        packet(0xa2, &empty),
        packet(0x82, &[&empty[..], &[0]].concat()),
        packet(0xc0, &[0]),
        packet(0x40, &[0, 1, 0, 0, 9]),
        packet(0x70, &[0, 1, 0, 0, 9]),
        packet(0xe0, &[0, 0, 9]),
    ] {
        let mut stage = Stage::new(Limits::default());
        let (link, _) = stage.join(&connect_with(&[], b"p"));
        stage.say(link, &bytes);
        let heard = stage.heard(link);
        assert_eq!(
            (heard[0].0, heard[0].1[0]),
            (DISCONNECT, reason::MALFORMED),
            "{bytes:02x?}"
        );
    }
    for bytes in [
        packet(0x40, &[0, 1, 0]),
        packet(0xe0, &[0]),
        packet(0xc0, &[0]),
        packet(0xa2, &[0, 7, 0, 0]),
    ] {
        let mut stage = Stage::new(Limits::default());
        let (link, _) = stage.join(&connect_three(2, &[]));
        stage.say(link, &bytes);
        assert!(stage.hub.is_closing(link), "{bytes:02x?}");
    }
}

#[test]
fn an_acknowledgement_must_belong_to_the_qos() {
    for (qos, kind, is_right) in [
        (1, 0x40, true),
        (1, 0x50, false),
        (1, 0x70, false),
        (2, 0x40, false),
        (2, 0x50, true),
        (2, 0x70, false),
    ] {
        let mut stage = Stage::new(Limits::default());
        let link = stage.reader("p", "t", qos);
        let (writer, _) = stage.join(&connect_with(&[], b"writer"));
        stage.say(writer, &publish("t", qos << 1, 1, &[], b"x"));
        stage.say(writer, &packet(0x62, &[0, 1]));
        stage.heard(link);
        stage.say(link, &packet(kind, &[0, 1]));
        assert_eq!(
            !stage.hub.is_closing(link),
            is_right,
            "{kind:02x} at QoS {qos}"
        );
        if qos == 2 && is_right {
            // Send PUBREC again, then PUBCOMP; the answer reports an unknown identifier.
            stage.say(link, &packet(0x50, &[0, 1]));
            stage.say(link, &packet(0x70, &[0, 1]));
            stage.say(link, &packet(0x50, &[0, 1]));
            let heard: Vec<_> = stage.heard(link);
            assert_eq!(heard.last().unwrap().1, [0, 1, reason::UNKNOWN_PACKET_ID]);
            assert!(!stage.hub.is_closing(link));
        }
    }
}
