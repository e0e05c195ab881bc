//! Batched evaluation: messages, refusals, and the end of a batch.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use std::time::Duration;

use common::{STEP_TIMEOUT, Server, Walk, batch, bits, object};
use serde_json::json;
use swarmwright_protocol::{BatchSensors, BatchStart, RefusalKind, ToServer, ToTool, Topic, U64s};
use swarmwright_testing::JointWalks;
use swarmwright_worlds::Simulation;

/// Answers every agent with half its first sensor until the batch ends. Returns the fitness by episode, and the failed
/// episodes.
fn play(server: &mut Server, message: BatchStart) -> (Vec<Option<f64>>, Vec<u64>) {
    let mut fitness = vec![None; message.seeds.0.len()];
    let mut failed = Vec::new();
    let request = message.request;
    server.ask(ToServer::Start(message));
    for step in 0.. {
        let [message] = &server.sensors()[..] else {
            panic!("one message a step")
        };
        assert_eq!((message.step, message.error.as_ref()), (step, None));
        for (episode, value) in message.ended.0.iter().zip(&message.fitness.0) {
            assert_eq!(fitness[*episode as usize].replace(*value), None);
        }
        failed.extend(message.failed.iter().map(|failure| failure.episode));
        if message.agents.0.is_empty() {
            return (fitness, failed);
        }
        let actuators = message
            .sensors
            .0
            .chunks(2)
            .map(|row| row[0] / 2.0)
            .collect();
        server.actuators(request, step, actuators);
    }
    unreachable!()
}

/// Returns the fitness of the same episodes, run one at a time without a server.
fn expected(message: &BatchStart) -> Vec<Option<f64>> {
    let evaluate = |seed: &u64| {
        let mut walk = Walk::default();
        let mut parameters = message.parameters.clone();
        parameters.insert("seed".to_owned(), (*seed).into());
        walk.reset(&parameters).unwrap();
        while !walk.acting().is_empty() {
            let mut sensors = [0.0; 2];
            let actuators: Vec<f32> = walk
                .acting()
                .iter()
                .map(|agent| {
                    walk.sense(*agent, &mut sensors);
                    (sensors[0] / 2.0).clamp(-1.0, 1.0)
                })
                .collect();
            walk.step(&actuators);
        }
        Some(walk.fitness())
    };
    message.seeds.0.iter().map(evaluate).collect()
}

#[test]
fn episodes_are_stepped_side_by_side_and_each_ends_on_its_own() {
    let mut server = Server::of_walks();
    side_by_side(&mut server, &[1, 256, 7]);
}

#[test]
fn a_simulation_steps_its_episodes_together() {
    let mut server = Server::new(vec![Box::<JointWalks>::default()]);
    side_by_side(&mut server, &[1, 100, 7]);
    let mut message = batch(9);
    message.seeds = U64s((0..101).collect());
    server.ask(ToServer::Start(message));
    let refusal = server.sensors().remove(0).error.unwrap();
    assert!(refusal.reason.contains("at most 100"), "{refusal:?}");
}

fn side_by_side(server: &mut Server, counts: &[u64]) {
    for (number, &count) in (1..).zip(counts) {
        let mut message = batch(number);
        message.seeds = U64s((0..count).map(|seed| seed * 37).collect());
        message.parameters = object(json!({"agents": 5}));
        assert_eq!(play(server, message.clone()), (expected(&message), vec![]));
        assert!(
            server.answers(Some("ada")) && !server.answers(Some("bob")),
            "held"
        );
    }
    assert_eq!(server.warnings, Vec::<String>::new());
}

#[test]
fn a_simulation_that_is_the_only_one_is_a_batch_of_one() {
    let mut server = Server::new(vec![Box::<Walk>::default()]);
    server.ask(ToServer::Start(batch(1)));
    let refusal = server.sensors().remove(0).error.unwrap();
    assert_eq!(refusal.kind, RefusalKind::Invalid);
    assert!(refusal.reason.contains("at most 1"), "{refusal:?}");
    let mut message = batch(2);
    message.seeds = U64s(vec![5]);
    assert_eq!(play(&mut server, message.clone()).0, expected(&message));
}

#[test]
fn an_episode_without_agents_has_its_fitness_at_once() {
    let mut server = Server::of_walks();
    let mut message = batch(1);
    message.parameters = object(json!({"agents": 0}));
    assert_eq!(play(&mut server, message).0, [Some(0.0); 3]);
}

#[test]
fn an_episode_that_fails_is_named_and_the_others_go_on() {
    fails_alone(Server::of_walks);
}

#[test]
fn an_episode_that_fails_amid_others_that_are_stepped_with_it_fails_alone() {
    fails_alone(|| Server::new(vec![Box::<JointWalks>::default()]));
}

fn fails_alone(make: fn() -> Server) {
    for trouble in ["panic", "fail", "reset", "sensor", "fitness"] {
        let mut server = make();
        let mut message = batch(1);
        message.seeds = U64s(vec![1, 3, 4, 6, 7]);
        let healthy = expected(&message);
        message.parameters = object(json!({"trouble": trouble}));
        let (fitness, failed) = play(&mut server, message);
        assert_eq!(failed, [1, 3], "{trouble}");
        for (episode, value) in fitness.into_iter().enumerate() {
            let sound = !matches!(episode, 1 | 3);
            assert_eq!(value, healthy[episode].filter(|_| sound), "{trouble}");
        }
        assert_eq!(
            play(&mut server, batch(2)).0,
            expected(&batch(2)),
            "{trouble}"
        );
    }
}

fn step(server: &mut Server) -> BatchSensors {
    let mut messages = server.sensors();
    assert_eq!(messages.len(), 1);
    messages.remove(0)
}

#[test]
fn actuators_that_do_not_fit_change_nothing() {
    let mut server = Server::of_walks();
    server.ask(ToServer::Start(batch(4)));
    assert_eq!(step(&mut server).agents.0, [0, 1, 0, 1, 0, 1]);
    for (request, number, count, word) in [
        (4, 0, 5, "5 actuators"),
        (4, 0, 7, "7 actuators"),
        (4, 1, 6, "step 1"),
        (9, 0, 6, "batch 9"),
    ] {
        server.actuators(request, number, vec![0.0; count]);
        assert!(server.replies.is_empty(), "{word}");
        assert!(server.warnings.pop().unwrap().contains(word), "{word}");
    }
    server.actuators(4, 0, vec![f32::NAN; 6]);
    assert!(server.warnings.pop().unwrap().contains("actuators"));
    server.actuators(4, 0, vec![1e30; 6]);
    assert_eq!(step(&mut server).step, 1);
    // The repeated message is too late.
    server.actuators(4, 0, vec![0.0; 6]);
    assert!(server.replies.is_empty());
    assert!(server.warnings.pop().unwrap().contains("step 0"));
}

#[test]
fn out_of_range_is_clamped_as_in_stepwise() {
    let fitness = |actuator: f32| {
        let mut server = Server::of_walks();
        server.ask(ToServer::Start(batch(1)));
        let mut all = Vec::new();
        for number in 0.. {
            let message = step(&mut server);
            all.extend(message.fitness.0);
            if message.agents.0.is_empty() {
                return all;
            }
            server.actuators(1, number, vec![actuator; message.agents.0.len()]);
        }
        unreachable!()
    };
    assert_eq!(bits(&fitness(7.5)), bits(&fitness(1.0)));
    assert_ne!(bits(&fitness(0.5)), bits(&fitness(1.0)));
}

#[test]
fn a_batch_ends_when_its_tool_says_so() {
    let mut server = Server::of_walks();
    server.ask(ToServer::Start(batch(1)));
    assert!(!server.answers(Some("ada")));
    server.replies.clear();
    server.actuators(1, 0, Vec::new());
    assert!(server.replies.is_empty());
    assert!(server.answers(Some("ada")) && !server.answers(None), "held");
    server.ask(ToServer::Start(batch(2)));
    let end = |tool: &str| json!({"server": 7, "simulation_hash": "h", "run": false, "tool": tool});
    server.say(Topic::Control, &end("bob"));
    assert!(!server.answers(None));
    server.say(Topic::Control, &end("ada"));
    assert!(server.answers(None), "free");
}

#[test]
fn a_second_batch_and_evaluations_wait_until_the_first_is_over() {
    let mut server = Server::of_walks();
    server.ask(ToServer::Start(batch(1)));
    server.replies.clear();
    server.ask(ToServer::Start(batch(2)));
    server.evaluate(common::request(3));
    let kinds: Vec<RefusalKind> = server
        .replies
        .drain(..)
        .map(|(_, message)| match message {
            ToTool::Sensors(message) => message.error.unwrap().kind,
            ToTool::Evaluated(message) => message.error.unwrap().kind,
            message @ (ToTool::Failed(_) | ToTool::Scene(_)) => panic!("{message:?}"),
        })
        .collect();
    assert_eq!(kinds, [RefusalKind::Taken, RefusalKind::Taken]);
    server.actuators(1, 0, vec![0.0; 6]);
    assert_eq!(step(&mut server).step, 1);
}

#[test]
fn a_tool_that_stops_answering_loses_the_server_after_the_step_timeout() {
    let mut server = Server::of_walks();
    server.ask(ToServer::Start(batch(1)));
    server.replies.clear();
    server.pass(Duration::from_secs(5));
    assert!(server.warnings.pop().unwrap().contains("ada has not sent"));
    server.pass(Duration::from_secs(5));
    assert!(server.warnings.is_empty(), "told once");
    server.pass(STEP_TIMEOUT);
    assert_eq!(step(&mut server).error.unwrap().kind, RefusalKind::Failed);
    assert!(server.answers(None));
    assert_eq!(play(&mut server, batch(2)).0, expected(&batch(2)));
}

#[test]
fn a_step_that_takes_longer_than_the_step_timeout_is_not_given_up() {
    let mut server = Server::of_walks();
    server.ask(ToServer::Start(batch(1)));
    server.replies.clear();
    server.took(2 * STEP_TIMEOUT);
    server.pass(Duration::ZERO);
    assert!(server.replies.is_empty() && server.warnings.is_empty());
    server.actuators(1, 0, vec![0.0; 6]);
    assert_eq!(step(&mut server).step, 1);
    server.took(2 * STEP_TIMEOUT);
    server.pass(STEP_TIMEOUT / 2);
    assert!(server.replies.is_empty());
    server.pass(STEP_TIMEOUT / 2);
    assert_eq!(step(&mut server).error.unwrap().kind, RefusalKind::Failed);
}

#[test]
fn what_cannot_be_started_is_refused_with_the_field_that_is_wrong() {
    let mut server = Server::of_walks();
    let change = |edit: &dyn Fn(&mut BatchStart)| {
        let mut message = batch(4);
        edit(&mut message);
        message
    };
    for (message, field) in [
        (change(&|m| m.simulation = "walc".into()), "simulation"),
        (change(&|m| m.seeds.0.clear()), "seeds"),
        (change(&|m| m.seeds.0 = vec![0; 257]), "seeds"),
        (change(&|m| m.version = 9), "version"),
        (
            change(&|m| m.parameters = object(json!({"agents": -1}))),
            "agents",
        ),
    ] {
        server.ask(ToServer::Start(message));
        let refusal = step(&mut server).error.unwrap();
        assert_eq!(refusal.kind, RefusalKind::Invalid);
        assert!(refusal.reason.contains(field), "{field}: {refusal:?}");
        assert!(server.answers(None), "{field}: free");
    }
    assert_eq!(play(&mut server, batch(5)).0, expected(&batch(5)));
}
