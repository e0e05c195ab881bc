//! Servers that do not report on work that others have finished: they hold up no work, are named, and recover.

#![allow(clippy::unwrap_used, reason = "a test")]

use crate::common;

use std::time::Duration;

use common::{CANDIDATES, Extended, Net, Party, SEEDS, begin, offloaded, party, undisturbed, work};
use swarmwright_pool::Mode;

const STUCK: u64 = 1;
const EVER: Duration = Duration::from_secs(1_000_000);

/// Evaluates a generation. Returns how long that took.
fn generation(net: &mut Net, index: usize) -> Duration {
    let start = net.now;
    net.submit(index, work(CANDIDATES, &SEEDS));
    assert_eq!(net.finish(index), undisturbed(CANDIDATES));
    net.now - start
}

#[test]
fn a_server_that_is_stuck_holds_up_one_generation_and_is_named_until_it_answers() {
    let mut net = Net::new(3);
    let stuck = net.add(Party::Extended(Box::new(offloaded(STUCK))));
    net.add(Party::Extended(Box::new(offloaded(2))));
    net.add(Party::Extended(Box::new(offloaded(3))));
    let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
    net.finish(index);
    let now = net.now;
    assert_eq!(net.tool(index).waiting(now), []);

    party(&mut net, stuck).pace = EVER;
    let held_up = generation(&mut net, index);
    assert!(held_up > Duration::from_millis(250), "{held_up:?}");
    let (since, asked) = (net.now, party(&mut net, stuck).blocks.len());
    for number in 0..20 {
        let took = generation(&mut net, index);
        assert!(took < Duration::from_millis(150), "{number}: {took:?}");
        let now = net.now;
        let named = net.tool(index).waiting(now);
        let silent = (now - since).as_secs_f64();
        assert_eq!(named.len(), 1, "{named:?}");
        assert!(named[0].server == STUCK && named[0].silent >= silent);
        assert!(
            named[0].evaluations > 1,
            "what it has not answered: {named:?}"
        );
        assert_eq!(net.tool(index).status(now).waiting_for.len(), 1);
    }
    let given = &party(&mut net, stuck).blocks[asked..];
    assert!(
        given.len() <= 21,
        "one in each, and one in the first: {given:?}"
    );
    assert!(given.iter().all(|(_, count)| *count == 1), "{given:?}");

    let revived = party(&mut net, stuck);
    (revived.pace, revived.busy_until) = (Duration::from_millis(1), None);
    revived.outgoing.clear();
    let asked = revived.blocks.len();
    for _ in 0..3 {
        generation(&mut net, index);
    }
    let now = net.now;
    assert_eq!(net.tool(index).waiting(now), []);
    let given = &party(&mut net, stuck).blocks[asked..];
    assert!(given.iter().any(|(_, count)| *count > 1), "{given:?}");
}

#[test]
fn a_server_that_is_much_too_slow_is_named_and_holds_up_one_generation() {
    let mut net = Net::new(3);
    let slow = Extended {
        pace: Duration::from_secs(20),
        ..offloaded(STUCK)
    };
    net.add(Party::Extended(Box::new(slow)));
    net.add(Party::Extended(Box::new(offloaded(2))));
    let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
    net.finish(index);
    for number in 0..20 {
        let took = generation(&mut net, index);
        assert!(took < Duration::from_millis(200), "{number}: {took:?}");
    }
    let now = net.now;
    let named = net.tool(index).waiting(now);
    assert!(named[0].server == STUCK && named[0].silent > 2.0);
}

#[test]
fn on_a_busy_machine_a_server_that_pauses_is_not_taken_to_be_slow() {
    let backups = |slowdown: f64| {
        let mut net = Net::new(3);
        let pausing = net.add(Party::Extended(Box::new(offloaded(STUCK))));
        net.add(Party::Extended(Box::new(offloaded(2))));
        net.add(Party::Extended(Box::new(offloaded(3))));
        let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
        net.finish(index);
        net.tool(index).set_slowdown(slowdown);
        party(&mut net, pausing).pace = Duration::from_millis(100);
        generation(&mut net, index);
        net.tool(index).counts().backups
    };
    assert!(backups(1.0) > 0);
    assert_eq!(backups(20.0), 0);
}
