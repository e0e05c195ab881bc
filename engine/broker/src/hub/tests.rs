//! Conversations with the broker without sockets: hours pass in an instant.

use super::*;
use proptest::prelude::*;

const CONNACK: u8 = 0x20;
const PUBLISH: u8 = 0x30;
const DISCONNECT: u8 = 0xe0;

/// A hub and a clock that only moves when told.
struct Stage {
    hub: Hub,
    now: Instant,
}

fn text(text: &str) -> Vec<u8> {
    let mut bytes = (text.len() as u16).to_be_bytes().to_vec();
    bytes.extend(text.as_bytes());
    bytes
}

fn packet(first: u8, body: &[u8]) -> Vec<u8> {
    let mut bytes = vec![first];
    let mut length = body.len();
    while length > 0x7f {
        bytes.push((length & 0x7f) as u8 | 0x80);
        length >>= 7;
    }
    bytes.push(length as u8);
    bytes.extend(body);
    bytes
}

/// A CONNECT of MQTT 5: properties, and the will as (delay, topic) where there is one.
fn connect(
    id: &str,
    clean: bool,
    keep_alive: u16,
    expiry: u32,
    will: Option<(u32, &str)>,
) -> Vec<u8> {
    let mut body = text("MQTT");
    body.extend([5, u8::from(clean) << 1 | u8::from(will.is_some()) << 2]);
    body.extend(keep_alive.to_be_bytes());
    body.extend([5, 0x11]);
    body.extend(expiry.to_be_bytes());
    body.extend(text(id));
    if let Some((delay, topic)) = will {
        body.extend([5, 0x18]);
        body.extend(delay.to_be_bytes());
        body.extend(text(topic));
        body.extend(text("lost"));
    }
    packet(0x10, &body)
}

fn subscribe(filter: &str, options: u8) -> Vec<u8> {
    let mut body = vec![0, 7, 0];
    body.extend(text(filter));
    body.push(options);
    packet(0x82, &body)
}

fn publish(topic: &str, flags: u8, id: u16, properties: &[u8], payload: &[u8]) -> Vec<u8> {
    let mut body = text(topic);
    if flags & 6 != 0 {
        body.extend(id.to_be_bytes());
    }
    body.push(properties.len() as u8);
    body.extend(properties);
    body.extend(payload);
    packet(PUBLISH | flags, &body)
}

impl Stage {
    fn new(limits: Limits) -> Self {
        Self {
            hub: Hub::new(limits, None, None),
            now: Instant::now(),
        }
    }

    /// A connection that said CONNECT; its number and what CONNACK says of an earlier session.
    fn join(&mut self, connect: &[u8]) -> (usize, bool) {
        let link = self.hub.open("test".into(), self.now).unwrap();
        self.hub.receive(link, connect, self.now);
        let answer = self.heard(link);
        assert_eq!((answer[0].0, answer[0].1[1]), (CONNACK, 0), "{answer:?}");
        let present = answer[0].1[0] == 1;
        // What the session brought with it is for the caller.
        for (first, body) in answer.into_iter().skip(1) {
            self.hub.links[link].out.end().extend(packet(first, &body));
        }
        (link, present)
    }

    fn reader(&mut self, id: &str, filter: &str, options: u8) -> usize {
        let (link, _) = self.join(&connect(id, true, 0, 0, None));
        self.say(link, &subscribe(filter, options));
        assert_eq!(self.heard(link)[0].0, 0x90);
        link
    }

    fn say(&mut self, link: usize, bytes: &[u8]) {
        assert_eq!(self.hub.receive(link, bytes, self.now), bytes.len());
    }

    /// Everything sent to a connection since the last time: first byte and body of each packet.
    fn heard(&mut self, link: usize) -> Vec<(u8, Vec<u8>)> {
        let pending = self.hub.outbox(link).pending().to_vec();
        self.hub.sent(link, pending.len(), self.now);
        let mut packets = Vec::new();
        let mut rest = &pending[..];
        while let Ok(Some((first, head, body))) = codec::frame(rest, usize::MAX) {
            packets.push((first, rest[head..head + body].to_vec()));
            rest = &rest[head + body..];
        }
        assert!(rest.is_empty());
        packets
    }

    fn pass(&mut self, seconds: u64) {
        self.now += Duration::from_secs(seconds);
        self.hub.tick(self.now);
    }

    fn payloads(&mut self, link: usize) -> Vec<String> {
        let packets = self.heard(link);
        let bodies = packets.iter().filter(|(first, _)| first & 0xf0 == PUBLISH);
        bodies
            .map(|(first, body)| String::from_utf8_lossy(payload(*first, body)).into_owned())
            .collect()
    }
}

/// The payload of a PUBLISH of MQTT 5 whose properties are shorter than 128 bytes.
fn payload(first: u8, body: &[u8]) -> &[u8] {
    let topic = usize::from(u16::from_be_bytes([body[0], body[1]]));
    let properties = 2 + topic + if first & 6 != 0 { 2 } else { 0 };
    &body[properties + 1 + usize::from(body[properties])..]
}

#[test]
fn a_will_waits_for_its_delay_and_not_at_all_when_the_client_comes_back() {
    let mut stage = Stage::new(Limits::default());
    let reader = stage.reader("reader", "gone", 0);
    let (link, _) = stage.join(&connect("ada", false, 0, 100, Some((10, "gone"))));
    stage.hub.closed(link, stage.now);
    stage.pass(9);
    assert!(stage.payloads(reader).is_empty());
    let (link, present) = stage.join(&connect("ada", false, 0, 100, Some((10, "gone"))));
    assert!(present);
    stage.pass(20);
    assert!(stage.payloads(reader).is_empty());
    stage.hub.closed(link, stage.now);
    stage.pass(10);
    assert_eq!(stage.payloads(reader), ["lost"]);
}

#[test]
fn the_end_of_a_session_brings_its_will_before_the_delay_is_over() {
    let mut stage = Stage::new(Limits::default());
    let reader = stage.reader("reader", "gone", 0);
    let (link, _) = stage.join(&connect("ada", true, 0, 5, Some((1000, "gone"))));
    stage.hub.closed(link, stage.now);
    stage.pass(5);
    assert_eq!(stage.payloads(reader), ["lost"]);
}

#[test]
fn a_proper_goodbye_leaves_no_will() {
    let mut stage = Stage::new(Limits::default());
    let reader = stage.reader("reader", "gone", 0);
    let (link, _) = stage.join(&connect("ada", true, 0, 0, Some((0, "gone"))));
    stage.say(link, &[DISCONNECT, 0]);
    assert!(stage.hub.is_closing(link));
    stage.hub.closed(link, stage.now);
    let (link, _) = stage.join(&connect("ada", true, 0, 0, Some((0, "gone"))));
    stage.pass(1);
    assert!(stage.payloads(reader).is_empty());
    // "Disconnect with will message".
    stage.say(link, &[DISCONNECT, 1, 4]);
    assert_eq!(stage.payloads(reader), ["lost"]);
}

#[test]
fn silence_ends_a_connection_after_one_and_a_half_intervals() {
    let mut stage = Stage::new(Limits::default());
    let (link, _) = stage.join(&connect("ada", true, 10, 0, None));
    let (patient, _) = stage.join(&connect("bob", true, 0, 0, None));
    let stranger = stage.hub.open("stranger".into(), stage.now).unwrap();
    stage.pass(14);
    assert!(!stage.hub.is_closing(link) && stage.hub.is_closing(stranger));
    stage.say(link, &[0xc0, 0]);
    assert_eq!(stage.heard(link), [(0xd0, vec![])]);
    stage.pass(15);
    assert!(!stage.hub.is_closing(link));
    stage.pass(1);
    assert_eq!(stage.heard(link)[0].1[0], reason::KEEP_ALIVE_TIMEOUT);
    stage.pass(100_000);
    assert!(!stage.hub.is_closing(patient));
}

#[test]
fn an_absent_client_finds_its_messages_until_the_session_ends() {
    let mut stage = Stage::new(Limits::default());
    let (link, present) = stage.join(&connect("ada", false, 0, 60, None));
    assert!(!present);
    stage.say(link, &subscribe("a/#", 2));
    stage.heard(link);
    stage.hub.closed(link, stage.now);
    let (writer, _) = stage.join(&connect("writer", true, 0, 0, None));
    stage.say(writer, &publish("a/0", 0, 0, &[], b"qos 0 is not kept"));
    stage.say(
        writer,
        &publish("a/1", 2, 1, &[2, 0, 0, 0, 30], b"void by then"),
    );
    stage.say(writer, &publish("a/2", 4, 2, &[2, 0, 0, 0, 100], b"kept"));
    stage.pass(40);
    let (link, present) = stage.join(&connect("ada", false, 0, 60, None));
    assert!(present);
    let packets = stage.heard(link);
    assert_eq!(packets.len(), 1);
    assert_eq!(payload(packets[0].0, &packets[0].1), b"kept");
    // 100 s less the 40 that passed.
    assert!(
        packets[0]
            .1
            .windows(5)
            .any(|window| window == [2, 0, 0, 0, 60])
    );
    stage.hub.closed(link, stage.now);
    let (link, _) = stage.join(&connect("ada", false, 0, 60, None));
    let repeated = stage.heard(link);
    assert_eq!(repeated[0].0, PUBLISH | 8 | 4, "sent again, and says so");
    stage.hub.closed(link, stage.now);
    stage.pass(60);
    let (_, present) = stage.join(&connect("ada", false, 0, 60, None));
    assert!(!present);
}

#[test]
fn qos_2_comes_once_however_often_it_is_sent() {
    let mut stage = Stage::new(Limits::default());
    let reader = stage.reader("reader", "t", 2);
    let (writer, _) = stage.join(&connect("writer", true, 0, 0, None));
    for flags in [4, 12, 12] {
        stage.say(writer, &publish("t", flags, 9, &[], b"once"));
    }
    assert_eq!(stage.heard(writer), vec![(0x50, vec![0, 9]); 3]);
    stage.say(writer, &packet(0x62, &[0, 9]));
    assert_eq!(stage.heard(writer), [(0x70, vec![0, 9])]);
    let delivered = stage.heard(reader);
    assert_eq!(delivered.len(), 1);
    stage.say(reader, &packet(0x50, &[0, 1]));
    assert_eq!(stage.heard(reader), [(0x62, vec![0, 1])]);
    stage.say(reader, &packet(0x70, &[0, 1]));
    stage.say(
        writer,
        &publish("t", 4, 9, &[], b"the identifier is free again"),
    );
    assert_eq!(stage.payloads(reader).len(), 1);
}

#[test]
fn no_more_is_under_way_than_the_reader_takes() {
    let mut stage = Stage::new(Limits::default());
    let mut hello = text("MQTT");
    // Receive maximum 3.
    hello.extend([5, 2, 0, 0, 3, 0x21, 0, 3]);
    hello.extend(text("reader"));
    let (reader, _) = stage.join(&packet(0x10, &hello));
    stage.say(reader, &subscribe("t", 1));
    let (writer, _) = stage.join(&connect("writer", true, 0, 0, None));
    for id in 1..=10 {
        stage.say(
            writer,
            &publish("t", 2, id, &[], format!("{id}").as_bytes()),
        );
    }
    let mut seen = stage.payloads(reader);
    assert_eq!(seen, ["1", "2", "3"]);
    for id in 1..=10u8 {
        stage.say(reader, &packet(0x40, &[0, id]));
        seen.extend(stage.payloads(reader));
    }
    assert_eq!(seen, (1..=10).map(|id| id.to_string()).collect::<Vec<_>>());
}

#[test]
fn overlapping_subscriptions_give_one_copy_with_all_identifiers() {
    let mut stage = Stage::new(Limits::default());
    let (reader, _) = stage.join(&connect("reader", true, 0, 0, None));
    for (identifier, filter) in [(5u8, "a/+"), (6, "a/#"), (7, "b")] {
        let mut body = vec![0, 1, 2, 0x0b, identifier];
        body.extend(text(filter));
        body.push(0);
        stage.say(reader, &packet(0x82, &body));
    }
    stage.heard(reader);
    stage.say(reader, &publish("a/x", 0, 0, &[], b"hello"));
    let packets = stage.heard(reader);
    assert_eq!(packets.len(), 1);
    assert!(
        packets[0]
            .1
            .windows(4)
            .any(|window| window == [0x0b, 5, 0x0b, 6]),
        "{packets:?}"
    );
}

#[test]
fn no_local_and_retain_options() {
    let mut stage = Stage::new(Limits::default());
    let own = stage.reader("own", "t", 4);
    let as_published = stage.reader("as published", "t", 8);
    stage.say(own, &publish("t", 1, 0, &[], b"kept"));
    assert!(stage.payloads(own).is_empty());
    assert_eq!(stage.heard(as_published)[0].0, PUBLISH | 1);
    // Retain handling 0 always, 1 when new, 2 never.
    for (options, expected) in [(0, 1), (0x10, 0), (0x20, 0), (0, 1)] {
        stage.say(as_published, &subscribe("t", options));
        assert_eq!(stage.payloads(as_published).len(), expected, "{options:#x}");
    }
    stage.say(own, &publish("t", 1, 0, &[], b""));
    let late = stage.reader("late", "t", 0);
    assert!(stage.heard(late).is_empty());
}

#[test]
fn a_second_connection_takes_over() {
    let mut stage = Stage::new(Limits::default());
    let (first, _) = stage.join(&connect("ada", false, 0, 60, None));
    let (second, present) = stage.join(&connect("ada", false, 0, 60, None));
    assert!(present && stage.hub.is_closing(first) && !stage.hub.is_closing(second));
    assert_eq!(stage.heard(first)[0].1[0], reason::TAKEN_OVER);
    // The end of the first connection does not touch the second.
    stage.hub.closed(first, stage.now);
    stage.say(second, &[0xc0, 0]);
    assert_eq!(stage.heard(second), [(0xd0, vec![])]);
}

#[test]
fn a_reader_far_behind_gets_everything_up_to_the_bound_and_then_a_reason() {
    let mut stage = Stage::new(Limits {
        backlog: 1 << 20,
        ..Limits::default()
    });
    let reader = stage.reader("reader", "t", 0);
    let other = stage.reader("other", "t", 0);
    let (writer, _) = stage.join(&connect("writer", true, 0, 0, None));
    let message = publish("t", 0, 0, &[], &[7; 200]);
    let fitting = (1 << 20) / message.len();
    for _ in 0..fitting {
        stage.say(writer, &message);
        stage.heard(other);
    }
    assert!(!stage.hub.is_closing(reader));
    assert_eq!(stage.heard(reader).len(), fitting);
    for _ in 0..=fitting {
        stage.say(writer, &message);
        stage.heard(other);
    }
    assert!(stage.hub.is_closing(reader) && !stage.hub.is_closing(other));
    assert_eq!(stage.heard(reader)[0].1[0], reason::QUOTA_EXCEEDED);
}

#[test]
fn a_publisher_waits_for_a_reader_that_reads_and_not_for_one_that_stands_still() {
    let mut stage = Stage::new(Limits {
        backlog: 1 << 20,
        ..Limits::default()
    });
    let reader = stage.reader("reader", "t", 0);
    let (writer, _) = stage.join(&connect("writer", true, 0, 0, None));
    let message = publish("t", 0, 0, &[], &[7; 1000]);
    for _ in 0..600 {
        stage.say(writer, &message);
    }
    assert!(stage.hub.is_held(writer, stage.now));
    stage.now += Duration::from_secs(1);
    stage.hub.sent(reader, 10_000, stage.now);
    stage.now += Duration::from_millis(1900);
    assert!(stage.hub.is_held(writer, stage.now));
    stage.now += Duration::from_millis(200);
    assert!(!stage.hub.is_held(writer, stage.now));
    stage.hub.sent(reader, 10_000, stage.now);
    stage.say(writer, &message);
    assert!(stage.hub.is_held(writer, stage.now));
    let pending = stage.hub.outbox(reader).len();
    stage.hub.sent(reader, pending, stage.now);
    assert!(!stage.hub.is_held(writer, stage.now));
}

#[test]
fn nothing_is_left_of_clients_that_are_gone() {
    let mut stage = Stage::new(Limits::default());
    for round in 0..500u32 {
        let expiry = round % 3 * 30;
        let (link, _) = stage.join(&connect(
            &format!("client {round}"),
            true,
            0,
            expiry,
            Some((round % 7, "gone")),
        ));
        stage.say(link, &subscribe(&format!("topic/{round}"), 1));
        stage.say(
            link,
            &publish(&format!("topic/{round}"), 2, 1, &[], b"unacknowledged"),
        );
        stage.hub.closed(link, stage.now);
    }
    stage.pass(100);
    let hub = &stage.hub;
    assert_eq!(
        (
            hub.links.len(),
            hub.sessions.len(),
            hub.by_client.len(),
            hub.routes.len()
        ),
        (0, 0, 0, 0)
    );
}

#[test]
fn what_is_not_offered_is_refused_with_its_reason() {
    let cases: [(&[u8], u8); 9] = [
        (&publish("a/+", 0, 0, &[], b""), reason::BAD_TOPIC),
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
    /// Whatever clients say, the broker stays whole: sessions and links point at each other, and all of it goes away.
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
