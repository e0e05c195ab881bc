//! Exchange of packets with an independent implementation, `rumqttc`, in both directions.

use super::*;
use bytes::BytesMut;
use rumqttc::QoS;
use rumqttc::mqttbytes::v4;
use rumqttc::v5::mqttbytes::{QoS as QoS5, v5};

const PAYLOADS: [usize; 5] = [0, 1, 127, 20_000, 2_100_000];

fn written_by_v5(packet: v5::Packet) -> Vec<u8> {
    let mut bytes = BytesMut::new();
    packet.write(&mut bytes, None).unwrap();
    bytes.to_vec()
}

fn written_by_v4(packet: v4::Packet) -> Vec<u8> {
    let mut bytes = BytesMut::new();
    packet.write(&mut bytes, usize::MAX).unwrap();
    bytes.to_vec()
}

fn read_by_v5(bytes: &[u8]) -> v5::Packet {
    v5::Packet::read(&mut BytesMut::from(bytes), None).unwrap()
}

fn read_by_v4(bytes: &[u8]) -> v4::Packet {
    v4::Packet::read(&mut BytesMut::from(bytes), usize::MAX).unwrap()
}

fn packet_of(version: Version) -> Connect<'static> {
    Connect {
        version,
        client_id: "swärmwright-7",
        clean: true,
        keep_alive: 30,
        session_expiry: 0,
        receive_maximum: u16::MAX,
        maximum_packet: 1 << 26,
        will: Some(Will {
            topic: "lab/presence",
            payload: b"lost",
            properties: client::Properties {
                expiry: Some(60),
                ..client::Properties::default()
            }
            .encoded()
            .unwrap(),
            qos: 1,
            retain: true,
            delay: 0,
        }),
        user: Some("ada"),
        password: Some(b"secret"),
    }
}

#[test]
fn connect() {
    let mut out = Vec::new();
    client::connect(&mut out, &packet_of(Version::Five)).unwrap();
    let v5::Packet::Connect(connect, will, login) = read_by_v5(&out) else {
        panic!("{out:02x?}");
    };
    assert_eq!(
        (
            connect.client_id.as_str(),
            connect.clean_start,
            connect.keep_alive
        ),
        ("swärmwright-7", true, 30)
    );
    assert_eq!(
        connect.properties.as_ref().unwrap().max_packet_size,
        Some(1 << 26)
    );
    let last = will.as_ref().unwrap();
    assert_eq!(
        (&last.topic[..], &last.message[..]),
        (&b"lab/presence"[..], &b"lost"[..])
    );
    assert_eq!((last.qos, last.retain), (QoS5::AtLeastOnce, true));
    assert_eq!(
        last.properties.as_ref().unwrap().message_expiry_interval,
        Some(60)
    );
    let account = login.as_ref().unwrap();
    assert_eq!(
        (account.username.as_str(), account.password.as_str()),
        ("ada", "secret")
    );
    // Byte for byte the same.
    assert_eq!(
        written_by_v5(v5::Packet::Connect(connect, will, login)),
        out
    );

    out.clear();
    let packet = Connect {
        maximum_packet: u32::MAX,
        ..packet_of(Version::Three)
    };
    client::connect(&mut out, &packet).unwrap();
    let v4::Packet::Connect(connect) = read_by_v4(&out) else {
        panic!("{out:02x?}");
    };
    assert_eq!(
        (
            connect.client_id.as_str(),
            connect.clean_session,
            connect.keep_alive
        ),
        ("swärmwright-7", true, 30)
    );
    let last = connect.last_will.as_ref().unwrap();
    assert_eq!(
        (
            last.topic.as_str(),
            &last.message[..],
            last.qos,
            last.retain
        ),
        ("lab/presence", &b"lost"[..], QoS::AtLeastOnce, true)
    );
    assert_eq!(connect.login.as_ref().unwrap().password, "secret");
    assert_eq!(written_by_v4(v4::Packet::Connect(connect)), out);
}

#[test]
fn publish_of_five_in_both_directions() {
    let drawn = client::Properties {
        expiry: Some(9),
        content_type: Some("application/msgpack"),
        response_topic: Some("lab/tool/ä"),
        correlation: Some(&[0, 1, 255]),
    };
    for properties in [drawn, client::Properties::default()] {
        for (size, (qos, theirs)) in PAYLOADS.into_iter().zip(
            [(0, QoS5::AtMostOnce), (1, QoS5::AtLeastOnce)]
                .into_iter()
                .cycle(),
        ) {
            let payload = vec![7; size];
            let encoded = properties.encoded().unwrap();
            let id = if qos == 0 { 0 } else { 4711 };
            let outgoing = Outgoing {
                topic: "lab/server/7",
                payload: &payload,
                properties: &encoded,
                expiry: None,
                identifiers: &[],
                qos,
                retain: true,
                again: false,
                id,
            };
            let mut out = Vec::new();
            client::publish(&mut out, &outgoing, Version::Five, usize::MAX).unwrap();
            let v5::Packet::Publish(publish) = read_by_v5(&out) else {
                panic!("{size}");
            };
            assert_eq!(
                (&publish.topic[..], &publish.payload[..]),
                (&b"lab/server/7"[..], &payload[..])
            );
            assert_eq!(
                (publish.qos, publish.pkid, publish.retain, publish.dup),
                (theirs, id, true, false)
            );
            if let Some(found) = &publish.properties {
                assert_eq!(found.message_expiry_interval, properties.expiry);
                assert_eq!(found.content_type.as_deref(), properties.content_type);
                assert_eq!(found.response_topic.as_deref(), properties.response_topic);
                assert_eq!(found.correlation_data.as_deref(), properties.correlation);
            } else {
                assert_eq!(properties, client::Properties::default());
            }
            // Both sides decode the packets of `rumqttc`, which writes the properties in another order.
            let bytes = written_by_v5(v5::Packet::Publish(publish));
            assert_eq!(bytes.len(), out.len());
            let (Ok(client::Packet::Publish(ours)), Ok(Packet::Publish(same))) = (
                by_client(&bytes, Version::Five),
                by_broker(&bytes, Version::Five),
            ) else {
                panic!("{size}");
            };
            assert_eq!(ours, same);
            assert_eq!(
                (ours.topic, ours.payload, ours.id, ours.retain),
                ("lab/server/7", &payload[..], id, true)
            );
            assert_eq!(expiry_of(ours.properties), properties.expiry);
        }
    }
}

#[test]
fn publish_of_three_in_both_directions() {
    for size in PAYLOADS {
        for (qos, theirs) in [(0, QoS::AtMostOnce), (1, QoS::AtLeastOnce)] {
            let payload = vec![7; size];
            let id = if qos == 0 { 0 } else { 4711 };
            let outgoing = Outgoing {
                topic: "lab/ä",
                payload: &payload,
                properties: &[],
                expiry: None,
                identifiers: &[],
                qos,
                retain: false,
                again: false,
                id,
            };
            let mut out = Vec::new();
            client::publish(&mut out, &outgoing, Version::Three, usize::MAX).unwrap();
            let v4::Packet::Publish(publish) = read_by_v4(&out) else {
                panic!("{size}");
            };
            assert_eq!(
                (
                    publish.topic.as_str(),
                    &publish.payload[..],
                    publish.qos,
                    publish.pkid
                ),
                ("lab/ä", &payload[..], theirs, id)
            );
            assert_eq!(written_by_v4(v4::Packet::Publish(publish)), out);
            assert!(
                matches!(by_client(&out, Version::Three), Ok(client::Packet::Publish(message)) if message.payload == payload)
            );
        }
    }
}

#[test]
fn subscribe() {
    let filter = |filter, qos| Filter {
        filter,
        qos,
        no_local: true,
        retain_as_published: false,
        retain_handling: 0,
    };
    let filters = [filter("lab/+/#", 1), filter("ä", 0)];
    let mut out = Vec::new();
    client::subscribe(&mut out, 7, &filters, Version::Five).unwrap();
    let v5::Packet::Subscribe(subscribe) = read_by_v5(&out) else {
        panic!("{out:02x?}");
    };
    assert_eq!(subscribe.pkid, 7);
    let found: Vec<_> = subscribe
        .filters
        .iter()
        .map(|it| (it.path.as_str(), it.qos, it.nolocal))
        .collect();
    assert_eq!(
        found,
        [
            ("lab/+/#", QoS5::AtLeastOnce, true),
            ("ä", QoS5::AtMostOnce, true)
        ]
    );
    assert_eq!(written_by_v5(v5::Packet::Subscribe(subscribe)), out);

    out.clear();
    client::subscribe(&mut out, 7, &filters, Version::Three).unwrap();
    let v4::Packet::Subscribe(subscribe) = read_by_v4(&out) else {
        panic!("{out:02x?}");
    };
    assert_eq!(subscribe.filters[0].path, "lab/+/#");
    assert_eq!(written_by_v4(v4::Packet::Subscribe(subscribe)), out);
}

#[test]
fn pings_and_ends() {
    assert!(matches!(
        read_by_v5(&client::PINGREQ),
        v5::Packet::PingReq(_)
    ));
    assert_eq!(written_by_v4(v4::Packet::PingReq), client::PINGREQ);
    assert_eq!(written_by_v4(v4::Packet::Disconnect), client::DISCONNECT);
    let end = v5::Disconnect::new(v5::DisconnectReasonCode::NormalDisconnection);
    assert_eq!(
        written_by_v5(v5::Packet::Disconnect(end)),
        client::DISCONNECT
    );
    let pong = written_by_v4(v4::Packet::PingResp);
    assert_eq!(by_client(&pong, Version::Three), Ok(client::Packet::Pong));
    let end = v5::Packet::Disconnect(v5::Disconnect {
        reason_code: v5::DisconnectReasonCode::SessionTakenOver,
        properties: Some(v5::DisconnectProperties {
            session_expiry_interval: None,
            reason_string: Some("another one".into()),
            user_properties: vec![("k".into(), "v".into())],
            server_reference: Some("other:1883".into()),
        }),
    });
    let expected = client::Packet::Disconnect {
        code: reason::TAKEN_OVER,
        text: Some("another one"),
    };
    assert_eq!(by_client(&written_by_v5(end), Version::Five), Ok(expected));
    let mut out = Vec::new();
    disconnect(&mut out, reason::MALFORMED, "why", Version::Five, 100);
    assert!(
        matches!(read_by_v5(&out), v5::Packet::Disconnect(end) if end.reason_code == v5::DisconnectReasonCode::MalformedPacket)
    );
}

#[test]
fn answers() {
    let connack = v5::Packet::ConnAck(v5::ConnAck {
        session_present: true,
        code: v5::ConnectReturnCode::Success,
        properties: Some(v5::ConnAckProperties {
            session_expiry_interval: Some(5),
            receive_max: Some(20),
            max_qos: Some(1),
            retain_available: Some(0),
            max_packet_size: Some(4096),
            assigned_client_identifier: Some("me".into()),
            topic_alias_max: Some(3),
            reason_string: Some("welcome".into()),
            user_properties: vec![("k".into(), "v".into()), ("k".into(), "w".into())],
            wildcard_subscription_available: Some(1),
            subscription_identifiers_available: Some(0),
            shared_subscription_available: Some(0),
            server_keep_alive: Some(60),
            response_information: Some("info".into()),
            server_reference: Some("other".into()),
            authentication_method: None,
            authentication_data: None,
        }),
    });
    let expected = client::Packet::Connack(client::Connack {
        code: 0,
        text: Some("welcome"),
        present: true,
        keep_alive: Some(60),
        receive_maximum: 20,
        maximum_packet: 4096,
        maximum_qos: 1,
        retains: false,
    });
    assert_eq!(
        by_client(&written_by_v5(connack), Version::Five),
        Ok(expected)
    );
    let refused = v4::Packet::ConnAck(v4::ConnAck::new(
        v4::ConnectReturnCode::BadUserNamePassword,
        false,
    ));
    assert!(matches!(
        by_client(&written_by_v4(refused), Version::Three),
        Ok(client::Packet::Connack(connack)) if connack.code == reason::BAD_PASSWORD
    ));
    let suback = v5::Packet::SubAck(v5::SubAck {
        pkid: 7,
        return_codes: vec![
            v5::SubscribeReasonCode::Success(QoS5::AtLeastOnce),
            v5::SubscribeReasonCode::NotAuthorized,
        ],
        properties: None,
    });
    let expected = client::Packet::Suback {
        id: 7,
        codes: &[1, 0x87],
        text: None,
    };
    assert_eq!(
        by_client(&written_by_v5(suback), Version::Five),
        Ok(expected)
    );
    let codes = vec![
        v4::SubscribeReasonCode::Success(QoS::AtMostOnce),
        v4::SubscribeReasonCode::Failure,
    ];
    let suback = v4::Packet::SubAck(v4::SubAck::new(7, codes));
    let expected = client::Packet::Suback {
        id: 7,
        codes: &[0, 0x80],
        text: None,
    };
    assert_eq!(
        by_client(&written_by_v4(suback), Version::Three),
        Ok(expected)
    );
    let puback = v5::Packet::PubAck(v5::PubAck {
        pkid: 7,
        reason: v5::PubAckReason::QuotaExceeded,
        properties: Some(v5::PubAckProperties {
            reason_string: Some("full".into()),
            user_properties: Vec::new(),
        }),
    });
    let expected = client::Packet::Puback {
        id: 7,
        code: reason::QUOTA_EXCEEDED,
        text: Some("full"),
    };
    assert_eq!(
        by_client(&written_by_v5(puback), Version::Five),
        Ok(expected)
    );
    for version in [Version::Three, Version::Five] {
        let mut out = Vec::new();
        acknowledge(&mut out, Answer::Acknowledged, 7, reason::SUCCESS, version);
        match version {
            Version::Three => {
                assert!(matches!(read_by_v4(&out), v4::Packet::PubAck(ack) if ack.pkid == 7))
            }
            Version::Five => assert!(
                matches!(read_by_v5(&out), v5::Packet::PubAck(ack) if ack.pkid == 7 && ack.reason == v5::PubAckReason::Success)
            ),
        }
    }
}
