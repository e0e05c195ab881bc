//! Wills, sessions, keep-alive.

use super::*;

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
fn a_regular_disconnection_discards_the_will() {
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
    let silent = stage.hub.open("silent".into(), stage.now).unwrap();
    stage.pass(14);
    assert!(!stage.hub.is_closing(link) && stage.hub.is_closing(silent));
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
    // 100 s minus the 40 s that have passed.
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
