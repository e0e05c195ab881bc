//! Limits on what clients can make the broker store and do.

use super::*;
use crate::session::MOST_FILTERS;

const SUBACK: u8 = 0x90;
const MIB: usize = 1 << 20;

/// Encodes a SUBSCRIBE with many filters.
fn subscribe_all(filters: &[String]) -> Vec<u8> {
    let mut body = vec![0, 7, 0];
    for filter in filters {
        body.extend(text(filter));
        body.push(0);
    }
    packet(0x82, &body)
}

fn small() -> Limits {
    Limits {
        memory: 16 * MIB,
        ..Limits::default()
    }
}

#[test]
fn more_filters_than_a_client_may_have_are_refused_one_by_one() {
    let mut stage = Stage::new(Limits::default());
    let (greedy, _) = stage.join(&connect("greedy", true, 0, 0, None));
    let filters: Vec<String> = (0..300_000).map(|number| format!("f/{number}")).collect();
    stage.say(greedy, &subscribe_all(&filters));
    let answer = stage.heard(greedy).remove(0);
    let granted = answer.1[3..].iter().filter(|&&code| code == 0).count();
    let refused = answer.1[3..]
        .iter()
        .filter(|&&code| code == reason::QUOTA_EXCEEDED)
        .count();
    assert_eq!(
        (answer.0, granted, refused),
        (SUBACK, MOST_FILTERS, 300_000 - MOST_FILTERS)
    );
    assert_eq!(stage.hub.complaints.count(Kind::Full), 1);
    // A client that unsubscribes from some filters may subscribe to others.
    let mut body = vec![0, 8, 0];
    body.extend(text("f/0"));
    stage.say(greedy, &packet(0xa2, &body));
    stage.say(greedy, &subscribe("f/299999", 0));
    let codes: Vec<u8> = stage
        .heard(greedy)
        .iter()
        .map(|(_, body)| body[3])
        .collect();
    assert_eq!(codes, [0, 0]);
}

#[test]
fn filters_too_deep_or_too_long_together_are_refused() {
    let mut stage = Stage::new(Limits::default());
    let (greedy, _) = stage.join(&connect("greedy", true, 0, 0, None));
    stage.say(greedy, &subscribe(&"a/".repeat(200), 0));
    assert_eq!(stage.heard(greedy)[0].1[3], reason::BAD_FILTER);
    let long: Vec<String> = (0..1000)
        .map(|number| format!("{number}{}", "/x".repeat(100)))
        .collect();
    stage.say(greedy, &subscribe_all(&long));
    let answer = stage.heard(greedy).remove(0);
    let granted = answer.1[3..].iter().filter(|&&code| code == 0).count();
    assert!((100..400).contains(&granted), "{granted}");
    assert!(stage.hub.memory() < 8 * MIB);
}

#[test]
fn retained_messages_for_many_filters_do_not_delay_other_clients() {
    let mut stage = Stage::new(Limits::default());
    let (writer, _) = stage.join(&connect("writer", true, 0, 0, None));
    for number in 0..20_000 {
        stage.say(writer, &publish(&format!("{number}/x"), 1, 0, &[], b"kept"));
    }
    let (greedy, _) = stage.join(&connect("greedy", true, 0, 0, None));
    let mut filters: Vec<String> = (0..500).map(|number| format!("+/y{number}")).collect();
    filters.push("+/x".into());
    stage.say(greedy, &subscribe_all(&filters));
    assert_eq!(stage.heard(greedy)[0].0, SUBACK);
    // Nothing has been found yet, and other clients are served between the slices.
    assert!(stage.hub.is_searching() && stage.hub.is_held(greedy, stage.now));
    let reader = stage.reader("reader", "0/x", 0);
    stage.say(writer, &publish("0/x", 0, 0, &[], b"live"));
    assert_eq!(stage.payloads(reader), ["live"]);
    assert_eq!(stage.payloads(greedy), ["live"]);
    let (mut found, mut slices) = (0, 0);
    while stage.hub.is_searching() {
        assert!(stage.hub.search(stage.now));
        found += stage.payloads(greedy).len();
        slices += 1;
    }
    assert_eq!(found, 20_000);
    assert!(slices >= 501 * 20_000 / 2000, "{slices} slices");
    assert!(!stage.hub.is_held(greedy, stage.now));
}

#[test]
fn retained_messages_wait_for_a_reader_that_is_behind() {
    let limits = Limits {
        backlog: 4 * MIB,
        ..Limits::default()
    };
    let mut stage = Stage::new(limits);
    let (writer, _) = stage.join(&connect("writer", true, 0, 0, None));
    for number in 0..100 {
        stage.say(
            writer,
            &publish(&format!("{number}"), 1, 0, &[], &vec![7; 100_000]),
        );
    }
    let (reader, _) = stage.join(&connect("reader", true, 0, 0, None));
    stage.say(reader, &subscribe("+", 0));
    while stage.hub.search(stage.now) {}
    assert!(stage.hub.outbox(reader).len() < 2 * MIB);
    let mut found = stage.payloads(reader).len();
    while stage.hub.is_searching() {
        stage.hub.search(stage.now);
        found += stage.payloads(reader).len();
    }
    assert_eq!(found, 100);
}

#[test]
fn a_client_that_does_not_read_answers_is_not_read() {
    let mut stage = Stage::new(Limits::default());
    let (rude, _) = stage.join(&connect("rude", true, 60, 0, None));
    let pings = [0xc0, 0].repeat(1000);
    let mut sent = 0;
    while !stage.hub.is_held(rude, stage.now) && sent < 100_000_000 {
        stage.say(rude, &pings);
        sent += pings.len();
    }
    assert!(sent < MIB, "{sent} bytes of PINGREQ were read");
    stage.heard(rude);
    assert!(!stage.hub.is_held(rude, stage.now), "it has read");
    while !stage.hub.is_held(rude, stage.now) {
        stage.say(rude, &pings);
    }
    stage.pass(91);
    assert!(
        stage.hub.is_closing(rude),
        "it takes nothing for one and a half keep-alive intervals"
    );
}

#[test]
fn sessions_of_absent_clients_are_kept_within_the_budget_the_newest_longest() {
    let mut stage = Stage::new(small());
    for number in 0..20_000 {
        let id = format!("{number}{}", "x".repeat(2000));
        let (link, _) = stage.join(&connect(&id, false, 0, 3600, None));
        stage.hub.closed(link, stage.now);
        assert!(stage.hub.memory() < 16 * MIB, "{number}");
        stage.now += Duration::from_millis(1);
    }
    let (_, present) = stage.join(&connect(
        &format!("19999{}", "x".repeat(2000)),
        false,
        0,
        3600,
        None,
    ));
    assert!(present);
    let (_, present) = stage.join(&connect(
        &format!("0{}", "x".repeat(2000)),
        false,
        0,
        3600,
        None,
    ));
    assert!(!present);
}

#[test]
fn many_inactive_readers_are_disconnected_before_memory_ends() {
    let limits = Limits {
        backlog: 8 * MIB,
        ..small()
    };
    let mut stage = Stage::new(limits);
    let honest = stage.reader("honest", "flood", 0);
    let still: Vec<usize> = (0..40)
        .map(|number| stage.reader(&format!("still{number}"), "flood", 0))
        .collect();
    let (writer, _) = stage.join(&connect("writer", true, 0, 0, None));
    for _ in 0..400 {
        stage.now += Duration::from_millis(50);
        stage.hub.tick(stage.now);
        if !stage.hub.is_held(writer, stage.now) {
            stage.say(writer, &publish("flood", 0, 0, &[], &vec![7; 100_000]));
        }
        stage.heard(honest);
        assert!(stage.hub.memory() < 24 * MIB, "{}", stage.hub.memory());
    }
    assert!(!stage.hub.is_closing(honest) && !stage.hub.is_closing(writer));
    assert!(still.iter().any(|&link| stage.hub.is_closing(link)));
}

#[test]
fn while_memory_is_short_only_clients_that_fill_it_are_read_later() {
    let limits = Limits {
        backlog: 8 * MIB,
        ..small()
    };
    let mut stage = Stage::new(limits);
    for number in 0..40 {
        stage.reader(&format!("still{number}"), "flood", 0);
    }
    let honest = stage.reader("honest", "echo", 0);
    let (writer, _) = stage.join(&connect("writer", true, 0, 0, None));
    while !stage.hub.is_held(writer, stage.now) {
        stage.say(writer, &publish("flood", 0, 0, &[], &vec![7; 100_000]));
    }
    assert!(stage.hub.memory() > 12 * MIB, "{}", stage.hub.memory());
    stage.say(honest, &publish("echo", 0, 0, &[], b"still there?"));
    assert_eq!(stage.payloads(honest), ["still there?"]);
    assert!(!stage.hub.is_held(honest, stage.now) && stage.hub.is_held(writer, stage.now));
}

#[test]
fn incomplete_packets_count_towards_the_budget() {
    let mut stage = Stage::new(small());
    let honest = stage.reader("honest", "t", 0);
    let links: Vec<usize> = (0..40)
        .map(|number| {
            stage
                .join(&connect(&format!("{number}"), true, 0, 0, None))
                .0
        })
        .collect();
    for &link in &links {
        // The server's buffer for a packet of 4 MiB.
        stage.hub.note_buffers(link, 4 * MIB, stage.now);
        for &link in &links {
            if stage.hub.is_closing(link) {
                stage.hub.note_buffers(link, 0, stage.now);
            }
        }
        assert!(stage.hub.memory() <= 16 * MIB, "{}", stage.hub.memory());
    }
    assert!(
        links
            .iter()
            .filter(|&&link| stage.hub.is_closing(link))
            .count()
            >= 30
    );
    assert!(!stage.hub.is_closing(honest));
}

#[test]
fn what_is_counted_goes_back_to_nothing() {
    let mut stage = Stage::new(Limits::default());
    let (writer, _) = stage.join(&connect("writer", true, 0, 0, None));
    let (reader, _) = stage.join(&connect("reader", false, 0, 3600, Some((0, "lost"))));
    stage.say(reader, &subscribe("a/+", 1));
    for number in 0..100 {
        stage.say(writer, &publish("a/b", 2, number + 1, &[], &[1; 1000]));
    }
    assert!(stage.hub.memory() > 100_000);
    stage.hub.closed(reader, stage.now);
    stage.hub.closed(writer, stage.now);
    stage.pass(3601);
    assert_eq!((stage.hub.memory(), stage.hub.absent), (0, 0));
}

#[test]
fn denied_messages_do_not_fill_the_log() {
    let mut stage = Stage::new(Limits::default());
    let (writer, _) = stage.join(&connect("writer", true, 0, 0, None));
    let session = stage.hub.links[writer].session.unwrap();
    for _ in 0..1000 {
        stage
            .hub
            .complain(Kind::Denied, session, stage.now, "may not publish to x");
    }
    assert_eq!(stage.hub.complaints.count(Kind::Denied), 1000);
    stage.pass(11);
    assert_eq!(stage.hub.complaints.count(Kind::Denied), 0);
}
