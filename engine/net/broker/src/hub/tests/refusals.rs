//! Refused packets, and arbitrary packets, which must not break the broker.

use super::*;
use proptest::prelude::*;

#[test]
fn what_is_not_offered_is_refused_with_its_reason() {
    let cases: [(&[u8], u8); 9] = [
        (&publish("a/+", 0, 0, &[], b""), reason::MALFORMED),
        (
            &publish("", 0, 0, &[0x23, 0, 1], b""),
            reason::BAD_TOPIC_ALIAS,
        ),
        (&publish("a", 6, 1, &[], b""), reason::MALFORMED),
        (&publish("a", 0, 0, &[0x0b, 1], b""), reason::PROTOCOL_ERROR),
        (
            &publish("a", 0, 0, &[1, 0, 1, 0], b""),
            reason::PROTOCOL_ERROR,
        ),
        (&packet(0x82, &[0, 0, 0]), reason::PROTOCOL_ERROR),
        (&connect("again", true, 0, 0, None), reason::PROTOCOL_ERROR),
        (&[0xf0, 0], reason::PROTOCOL_ERROR),
        (&[0x30, 0xff, 0xff, 0xff, 0x7f], reason::PACKET_TOO_LARGE),
    ];
    for (bytes, expected) in cases {
        let mut stage = Stage::new(Limits::default());
        let (link, _) = stage.join(&connect("ada", true, 0, 0, None));
        stage.say(link, bytes);
        let answer = stage.heard(link);
        assert_eq!(
            (answer[0].0, answer[0].1[0]),
            (DISCONNECT, expected),
            "{bytes:02x?}"
        );
        assert!(stage.hub.is_closing(link));
    }
    let mut stage = Stage::new(Limits::default());
    let (link, _) = stage.join(&connect("ada", true, 0, 0, None));
    stage.say(link, &subscribe("$share/group/t", 0));
    stage.say(link, &subscribe("a/#/b", 0));
    let codes: Vec<u8> = stage.heard(link).iter().map(|(_, body)| body[3]).collect();
    assert_eq!(codes, [reason::NO_SHARED_SUBSCRIPTIONS, reason::BAD_FILTER]);
}

fn exchange() -> impl Strategy<Value = Vec<u8>> {
    let junk = prop::collection::vec(any::<u8>(), 0..40);
    prop_oneof![
        junk.clone(),
        (any::<u8>(), junk).prop_map(|(first, body)| packet(first, &body)),
        ("[ab]/[ab]", 0u8..8, 1u16..5, "[a-z]{0,9}").prop_map(|(topic, flags, id, body)| publish(
            &topic,
            flags,
            id,
            &[],
            body.as_bytes()
        )),
        ("[ab+]/[ab#]", any::<u8>())
            .prop_map(|(filter, options)| subscribe(&filter, options & 0x2e)),
        (4u8..8, 1u8..5)
            .prop_map(|(kind, id)| packet(kind << 4 | if kind == 6 { 2 } else { 0 }, &[0, id])),
        "[a-c]".prop_map(|id| connect(&id, false, 1, 5, Some((1, "a/b")))),
        Just(vec![DISCONNECT, 0]),
    ]
}

proptest! {
    /// After arbitrary packets the state is consistent: sessions and links refer to each other, and all are removed in the end.
    #[test]
    fn nothing_that_clients_say_breaks_the_broker(steps in prop::collection::vec((0usize..4, exchange(), 0u64..3), 1..80)) {
        let mut stage = Stage::new(Limits::default());
        let mut links: [Option<usize>; 4] = [None; 4];
        for (who, bytes, wait) in steps {
            let link = *links[who].get_or_insert_with(|| {
                let link = stage.hub.open("test".into(), stage.now).unwrap();
                stage.hub.receive(link, &connect(&format!("client {who}"), false, 0, 10, None), stage.now);
                link
            });
            let done = stage.hub.receive(link, &bytes, stage.now);
            prop_assert!(done <= bytes.len());
            if stage.hub.is_closing(link) {
                stage.hub.closed(link, stage.now);
                links[who] = None;
            }
            stage.pass(wait);
            for (id, link) in &stage.hub.links {
                if let Some(session) = link.session {
                    prop_assert_eq!(stage.hub.sessions[session].link, Some(id));
                }
            }
            for (id, session) in &stage.hub.sessions {
                prop_assert_eq!(stage.hub.by_client.get(&session.client_id), Some(&id));
                if let Some(link) = session.link {
                    prop_assert_eq!(stage.hub.links[link].session, Some(id));
                }
            }
        }
        for link in links.into_iter().flatten() {
            stage.hub.closed(link, stage.now);
        }
        stage.pass(1000);
        prop_assert!(stage.hub.sessions.is_empty() && stage.hub.by_client.is_empty());
    }
}

#[test]
fn a_client_that_sends_too_fast_is_read_later_and_loses_nothing() {
    let mut stage = Stage::new(Limits {
        rate: 100,
        ..Limits::default()
    });
    let reader = stage.reader("reader", "t", 0);
    let (writer, _) = stage.join(&connect("writer", true, 0, 0, None));
    let burst = publish("t", 0, 0, &[], b"x").repeat(300);
    // Received bytes are processed; only the next read waits.
    assert!(!stage.hub.is_held(writer, stage.now));
    stage.say(writer, &burst);
    assert_eq!(stage.payloads(reader).len(), 300);
    assert!(stage.hub.is_held(writer, stage.now));
    assert!(!stage.hub.is_held(reader, stage.now));
    stage.now += Duration::from_secs(1);
    assert!(
        stage.hub.is_held(writer, stage.now),
        "100 of 200 too many are due"
    );
    stage.now += Duration::from_millis(1100);
    assert!(!stage.hub.is_held(writer, stage.now));
    // A client within its rate is never held back.
    for _ in 0..50 {
        stage.now += Duration::from_millis(500);
        stage.say(writer, &publish("t", 0, 0, &[], b"x").repeat(50));
        assert!(!stage.hub.is_held(writer, stage.now));
    }
}

#[test]
fn the_protocols_largest_message_is_taken_and_the_limit_is_announced() {
    let limits = Limits::default();
    assert!(
        limits.packet >= (64 << 20) + (1 << 16),
        "the protocol's largest message and its topic"
    );
    assert!(limits.backlog >= limits.packet, "it can be on its way");
}
