//! Server and simulator meet in the relay, each in a thread of its own.
#![allow(clippy::unwrap_used, clippy::panic)] // tests

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use swarmwright_worlds::{Description, Determinism, Parameters, Simulation};
use swarmwright_wrapper::{Notice, guarded};

use super::relay::{Answer, News, Relay, Request};
use super::relayed::Relayed;
use crate::error::Trouble;

fn description() -> Description {
    Description {
        title: "line".to_owned(),
        dimensions: 1,
        max_agents: None,
        sensors: 1,
        actuators: 1,
        metrics: Vec::new().into(),
        determinism: Determinism::Undeclared,
    }
}

fn look(relay: &Relay) -> News {
    relay.look(Instant::now() + Duration::from_secs(20)).0
}

fn sensed(x: f32) -> Answer {
    Answer::Sensed {
        agents: vec![0, 3],
        sensors: vec![x, 2.0 * x],
    }
}

#[test]
fn an_episode_goes_from_hand_to_hand() {
    let relay = Relay::new();
    let mut server = Relayed::new(Arc::clone(&relay), description());
    let serving = thread::spawn(move || {
        server.reset(&Parameters::new()).unwrap();
        let mut seen = [0.0];
        server.sense(3, &mut seen);
        let acting = server.acting().to_vec();
        server.step(&[0.25, 0.5]);
        (acting, seen, server.done(), server.fitness())
    });
    assert!(matches!(look(&relay), News::Asked(Request::Reset(_))));
    assert!(matches!(relay.look(Instant::now()).0, News::Nothing));
    relay.answer(sensed(1.5)).unwrap();
    let News::Asked(Request::Step(actuators)) = look(&relay) else {
        panic!("no step");
    };
    assert_eq!(actuators, [0.25, 0.5]);
    let end = Answer::Ended {
        fitness: 7.0,
        metrics: Vec::new(),
    };
    relay.answer(end).unwrap();
    assert_eq!(serving.join().unwrap(), (vec![0, 3], [3.0], true, 7.0));
}

#[test]
fn answers_out_of_turn_are_refused() {
    let relay = Relay::new();
    let Err(Trouble::Invalid(text)) = relay.answer(sensed(1.0)) else {
        panic!("taken");
    };
    assert!(text.starts_with("no episode is running"), "{text}");
    let asking = {
        let relay = Arc::clone(&relay);
        thread::spawn(move || relay.ask(Request::Reset(Box::default())).map(drop))
    };
    look(&relay);
    relay.answer(sensed(1.0)).unwrap();
    let Err(Trouble::Invalid(text)) = relay.answer(sensed(1.0)) else {
        panic!("taken");
    };
    assert!(
        text.starts_with("the actuators of the agents have not arrived"),
        "{text}"
    );
    assert_eq!(asking.join().unwrap(), Ok(()));
}

#[test]
fn who_waits_in_an_episode_learns_that_it_was_given_up() {
    let relay = Relay::new();
    let begin = || {
        let relay = Arc::clone(&relay);
        thread::spawn(move || relay.ask(Request::Reset(Box::default())).map(drop))
    };
    let asking = begin();
    look(&relay);
    relay.answer(sensed(1.0)).unwrap();
    asking.join().unwrap().unwrap();

    // The server is free: no tool waits for the agents any more.
    relay.tell(&Notice::Ready);
    let (news, notices) = relay.look(Instant::now());
    assert!(matches!(news, News::Abandoned));
    assert_eq!(notices, [Notice::Ready]);
    let late = relay.ask(Request::Step(vec![0.0, 0.0])).map(drop);
    assert_eq!(late, Err("the episode was given up".to_owned()));

    // Or another episode begins at once.
    for _ in 0..2 {
        let asking = begin();
        assert!(matches!(look(&relay), News::Asked(Request::Reset(_))));
        relay.answer(sensed(1.0)).unwrap();
        asking.join().unwrap().unwrap();
    }
    // That it is free when no episode is under way is not reported.
    let asking = begin();
    look(&relay);
    relay.answer(Answer::Failed("broken".to_owned())).unwrap();
    asking.join().unwrap().unwrap();
    relay.tell(&Notice::Ready);
    assert!(matches!(relay.look(Instant::now()).0, News::Nothing));
}

#[test]
fn a_simulator_that_goes_or_fails_ends_the_episode_with_a_reason() {
    for (close, reason) in [
        (true, "the simulator was closed"),
        (false, "a wheel is lost"),
    ] {
        let relay = Relay::new();
        let mut server = Relayed::new(Arc::clone(&relay), description());
        let serving = thread::spawn(move || guarded(|| server.reset(&Parameters::new())).map(drop));
        look(&relay);
        if close {
            relay.close();
        } else {
            relay.answer(Answer::Failed(reason.to_owned())).unwrap();
        }
        let result = serving.join().unwrap();
        assert_eq!(
            result.map_err(|failure| failure.reason),
            Err(reason.to_owned())
        );
    }
}

#[test]
fn an_empty_look_waits_as_long_as_it_is_told() {
    let start = Instant::now();
    let (news, notices) = Relay::new().look(start + Duration::from_millis(30));
    assert!(matches!(news, News::Nothing) && notices.is_empty());
    assert!(start.elapsed() >= Duration::from_millis(30));
}
