//! Delivery: which client receives which message, how often, and how far behind.

use super::*;

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
