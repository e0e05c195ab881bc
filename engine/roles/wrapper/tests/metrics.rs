//! Metrics: announced, sent with every stepwise fitness, and with other results on request.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use common::{ID, Server, batch, bits, object, request};
use serde_json::{Value, json};
use swarmwright_protocol::{RefusalKind, ToServer, ToTool, Topic, U64s};
use swarmwright_worlds::Minisim;

/// Returns the fitness message of an episode of the walk in which no agent moves.
fn stepwise(trouble: &str) -> Value {
    let server = walked(trouble, None);
    let (topic, payload) = server.published.last().unwrap();
    assert_eq!(*topic, Topic::Fitness, "{:?}", server.warnings);
    serde_json::from_slice(payload).unwrap()
}

/// Returns a server after such an episode of a tool that receives failures on `reply`.
fn walked(trouble: &str, reply: Option<&str>) -> Server {
    let mut server = Server::of_walks();
    let hash = "h";
    let parameters =
        json!({"server": ID, "simulation_hash": hash, "agents": 1, "seed": 3, "trouble": trouble});
    server.say(Topic::Parameters, &parameters);
    server.say(
        Topic::Control,
        &json!({"server": ID, "simulation_hash": hash, "tool": "lab", "reply": reply}),
    );
    for _ in 0..4 {
        let actuator = json!({"simulation_hash": hash, "agent": 0, "actuator": [0.5]});
        server.say(Topic::Actuator, &actuator);
    }
    server
}

#[test]
fn a_stepwise_fitness_comes_with_all_metrics_that_a_message_can_carry() {
    let message = stepwise("");
    let fitness = message["fitness"].as_f64().unwrap();
    assert_eq!(
        message["metrics"],
        json!({"half": fitness / 2.0, "steps": 4.0})
    );
    // Invalid metrics must not affect a tool that does not know metrics.
    assert_eq!(stepwise("metrics")["metrics"], json!({"steps": 4.0}));
    let message = stepwise("metrics panic");
    assert_eq!(message.get("metrics"), None);
    assert_eq!(message["fitness"].as_f64(), Some(fitness));
    let warnings = walked("metrics panic", None).warnings;
    assert_eq!(
        warnings,
        ["the metrics are left out: the simulation panicked: no ruler"]
    );
}

#[test]
fn metrics_that_fail_are_a_failure_to_a_tool_that_hears_of_it() {
    let server = walked("metrics panic", Some("swarmwright/v1/tool/lab"));
    assert!(
        server
            .published
            .iter()
            .all(|(topic, _)| *topic != Topic::Fitness)
    );
    let [(topic, ToTool::Failed(failed))] = &server.replies[..] else {
        panic!("{:?}", server.replies);
    };
    assert_eq!(topic, "swarmwright/v1/tool/lab");
    assert_eq!(failed.reason, "the simulation panicked: no ruler");
}

#[test]
fn metrics_are_announced() {
    let mut server = Server::new(vec![Box::<Minisim>::default()]);
    let discovery =
        json!({"simulation": "minisim", "simulation_hash": "h", "requirements": {"dimensions": 2}});
    server.say(Topic::Discovery, &discovery);
    let answer: Value = serde_json::from_slice(&server.published[0].1).unwrap();
    let names = json!(["arrived", "caught", "steps", "distance"]);
    assert_eq!(answer["capabilities"]["swarmwright"]["metrics"], names);
}

#[test]
fn an_answer_has_the_metrics_that_were_asked_for_and_no_others() {
    let mut server = Server::of_walks();
    for names in [&["steps", "half"][..], &["half"], &[]] {
        let mut message = request(1);
        message.metrics = names.iter().map(ToString::to_string).collect();
        server.evaluate(message);
        server.compute();
        let result = server.results().remove(0);
        let mut sorted = names.to_vec();
        sorted.sort_unstable();
        assert_eq!(result.metrics.keys().collect::<Vec<_>>(), sorted);
        let halves: Vec<f64> = result
            .fitness
            .0
            .iter()
            .map(|fitness| fitness / 2.0)
            .collect();
        if let Some(half) = result.metrics.get("half") {
            assert_eq!(bits(&half.0), bits(&halves));
        }
        if let Some(steps) = result.metrics.get("steps") {
            assert_eq!(steps.0, [5.0; 4]);
        }
    }
}

#[test]
fn a_metric_that_is_named_twice_is_refused() {
    let mut server = Server::of_walks();
    let names = || vec!["steps".to_owned(), "half".to_owned(), "steps".to_owned()];
    let mut message = request(1);
    message.metrics = names();
    server.evaluate(message);
    let block = server.results().remove(0).error.unwrap();
    let mut start = batch(2);
    start.metrics = names();
    server.ask(ToServer::Start(start));
    let batch = server.sensors().remove(0).error.unwrap();
    for refusal in [block, batch] {
        assert_eq!(refusal.kind, RefusalKind::Invalid);
        assert_eq!(refusal.reason, "metrics: \"steps\" is named twice");
    }
}

#[test]
fn a_simulation_that_evaluates_blocks_itself_gives_them_too() {
    let mut server = Server::new(vec![Box::<Minisim>::default()]);
    let controller = json!({"version": 1, "kind": "layered", "sensors": 4, "actuators": 1, "hidden": [],
        "activation": "tanh", "output_range": [-1, 1]});
    let mut message = request(1);
    message.simulation = "minisim".to_owned();
    message.controller = object(controller);
    message.genomes.0 = (0..5 * 40).map(|index| (index as f32).sin()).collect();
    message.metrics = vec!["distance".to_owned(), "steps".to_owned()];
    server.evaluate(message);
    server.compute();
    let result = server.results().remove(0);
    assert_eq!(result.fitness.0.len(), 80);
    let distances: Vec<f64> = result
        .fitness
        .0
        .iter()
        .map(|fitness| 0.0 - fitness)
        .collect();
    assert_eq!(bits(&result.metrics["distance"].0), bits(&distances));
    assert!(
        result.metrics["steps"]
            .0
            .iter()
            .all(|steps| (1.0..=15.0).contains(steps))
    );
}

#[test]
fn an_episode_whose_metric_is_no_number_has_failed_where_it_was_asked_for() {
    for (trouble, reason) in [
        ("metrics", "metric half is inf"),
        ("metrics panic", "no ruler"),
    ] {
        let mut message = request(1);
        message.parameters = object(json!({"trouble": trouble}));
        message.seeds = U64s(vec![1, 3]);
        let mut server = Server::of_walks();
        server.evaluate(message.clone());
        server.compute();
        assert!(
            server.results().remove(0).failed.is_empty(),
            "not asked for"
        );
        message.metrics = vec!["steps".to_owned(), "half".to_owned()];
        server.evaluate(message);
        server.compute();
        let result = server.results().remove(0);
        let failed: Vec<_> = result
            .failed
            .iter()
            .map(|f| (f.candidate, f.episode))
            .collect();
        assert_eq!(failed, [(0, 1), (1, 1)]);
        assert!(
            result.failed[0].reason.contains(reason),
            "{:?}",
            result.failed[0]
        );
        for values in [
            &result.fitness,
            &result.metrics["steps"],
            &result.metrics["half"],
        ] {
            let missing: Vec<bool> = values.0.iter().map(|value| value.is_nan()).collect();
            assert_eq!(missing, [false, true, false, true]);
        }
    }
}

#[test]
fn in_a_batch_metrics_come_with_the_fitness_of_each_episode() {
    for (trouble, lost) in [("", None), ("metrics", Some(2)), ("metrics panic", Some(2))] {
        let mut server = Server::of_walks();
        let mut message = batch(1);
        message.parameters = object(json!({"agents": 2, "trouble": trouble}));
        message.metrics = vec!["half".to_owned(), "steps".to_owned()];
        server.ask(ToServer::Start(message));
        let mut ended = Vec::new();
        for step in 0.. {
            let message = server.sensors().remove(0);
            for (place, episode) in message.ended.0.iter().enumerate() {
                ended.push(*episode);
                let half = message.fitness.0[place] / 2.0;
                assert_eq!(message.metrics["half"].0[place].to_bits(), half.to_bits());
                assert_eq!(message.metrics["steps"].0[place], 5.0);
            }
            assert_eq!(
                message.metrics.len(),
                if message.ended.0.is_empty() { 0 } else { 2 }
            );
            if message.agents.0.is_empty() {
                let failed: Vec<u64> = message
                    .failed
                    .iter()
                    .map(|failure| failure.episode)
                    .collect();
                assert_eq!(failed, lost.into_iter().collect::<Vec<_>>(), "{trouble}");
                break;
            }
            let actuators = vec![0.25; message.agents.0.len()];
            server.actuators(1, step, actuators);
        }
        let expected: Vec<u32> = (0..3)
            .filter(|episode| lost != Some(u64::from(*episode)))
            .collect();
        assert_eq!(ended, expected, "{trouble}");
    }
}

#[test]
fn a_metric_that_there_is_not_is_refused_by_name() {
    let mut server = Server::of_walks();
    let mut message = request(1);
    message.metrics = vec!["steps".to_owned(), "stpes".to_owned()];
    server.evaluate(message);
    let refusal = server.results().remove(0).error.unwrap();
    assert_eq!(refusal.kind, RefusalKind::Invalid);
    assert_eq!(
        refusal.reason,
        "metrics: \"stpes\" is not a metric of walk; it has steps, half"
    );
    let mut message = batch(2);
    message.metrics = vec!["stpes".to_owned()];
    server.ask(ToServer::Start(message));
    let refusal = server.sensors().remove(0).error.unwrap();
    assert!(refusal.reason.contains("stpes"), "{refusal:?}");
    // The simulation was put back, so the next batch can use it.
    server.ask(ToServer::Start(batch(3)));
    assert!(server.sensors().remove(0).error.is_none());
}
