//! Offloaded evaluation: reservation of the server, refusals, and failing simulations.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use std::sync::Arc;
use std::time::Duration;

use common::{Server, Walk, architecture, batch, bits, network, object, request};
use serde_json::{Value, json};
use swarmwright_controllers::Controller;
use swarmwright_evolution::{GaussianSample, Scale};
use swarmwright_protocol::{
    Evaluate, F32s, F64s, Message, NORMAL, RefusalKind, Sample, State, ToServer, ToTool, Topic,
    Topics, U64s,
};
use swarmwright_worlds::{Minisim, rollout};

/// Returns the fitness from `rollout` for every candidate and episode of a request for the walk.
fn expected(message: &Evaluate) -> Vec<f64> {
    let architecture = Arc::new(architecture(&message.controller));
    let mut fitness = Vec::new();
    for genome in message.genomes.0.chunks(architecture.weight_count()) {
        let controller = Controller::with_weights(&architecture, genome.into()).unwrap();
        for seed in &message.seeds.0 {
            let mut parameters = message.parameters.clone();
            parameters.insert("seed".to_owned(), (*seed).into());
            fitness.push(rollout(&mut Walk::default(), &parameters, &controller).unwrap());
        }
    }
    fitness
}

#[test]
fn every_candidate_is_evaluated_in_every_episode() {
    let mut server = Server::of_walks();
    let mut message = request(u64::MAX);
    message.parameters = object(json!({"agents": 3}));
    server.evaluate(message.clone());
    assert!(server.replies.is_empty(), "nothing before it is computed");
    server.compute();
    assert_eq!(server.replies[0].0, message.reply);
    let [result] = &server.results()[..] else {
        panic!("one answer")
    };
    assert_eq!(bits(&result.fitness.0), bits(&expected(&message)));
    assert_eq!((result.request, result.server), (u64::MAX, common::ID));
    assert!(result.failed.is_empty() && result.error.is_none() && result.seconds > 0.0);
    assert_eq!(server.warnings, Vec::<String>::new());
}

#[test]
fn requests_of_one_tool_wait_for_each_other_and_are_answered_in_order() {
    let mut server = Server::of_walks();
    for number in 0..20 {
        let mut message = request(number);
        message.seeds = U64s(vec![number]);
        // Every third request has other parameters.
        message.parameters = object(json!({"agents": 1 + number % 3}));
        server.evaluate(message);
    }
    server.compute();
    let results = server.results();
    let order: Vec<u64> = results.iter().map(|result| result.request).collect();
    assert_eq!(order, (0..20).collect::<Vec<_>>());
    for (number, result) in (0..20).zip(results) {
        let mut message = request(number);
        message.seeds = U64s(vec![number]);
        message.parameters = object(json!({"agents": 1 + number % 3}));
        assert_eq!(bits(&result.fitness.0), bits(&expected(&message)));
    }
}

#[test]
fn a_request_whose_lease_ran_out_before_its_turn_is_not_computed() {
    let mut server = Server::of_walks();
    server.evaluate(request(1));
    let mut late = request(2);
    late.lease = 1.0;
    server.evaluate(late);
    server.evaluate(request(3));
    server.now += Duration::from_secs(2);
    server.compute();
    let results = server.results();
    let errors: Vec<bool> = results
        .iter()
        .map(|result| result.error.is_some())
        .collect();
    assert_eq!(errors, [false, true, false]);
    let refusal = results[1].error.as_ref().unwrap();
    assert_eq!(refusal.kind, RefusalKind::Failed);
    assert!(refusal.reason.contains("lease"), "{refusal:?}");
}

fn taken(server: &mut Server, tool: &str) -> Option<String> {
    server.replies.clear();
    let mut message = request(99);
    message.tool = tool.to_owned();
    message.reply = format!("swarmwright/v1/tool/{tool}");
    server.evaluate(message);
    let answer = server
        .replies
        .iter()
        .find(|(topic, _)| topic.ends_with(tool));
    match &answer?.1 {
        ToTool::Evaluated(message) => message.error.as_ref().map(|refusal| {
            assert_eq!(refusal.kind, RefusalKind::Taken, "{refusal:?}");
            refusal.reason.clone()
        }),
        other => panic!("{other:?}"),
    }
}

#[test]
fn another_tool_is_told_at_once_that_the_server_is_taken() {
    let mut server = Server::of_walks();
    server.evaluate(request(1));
    // The server is computing.
    assert!(taken(&mut server, "bob").unwrap().contains("ada"));
    assert!(!server.answers(None) && !server.answers(Some("bob")));
    let mut start = batch(5);
    start.tool = "bob".to_owned();
    server.replies.clear();
    server.ask(ToServer::Start(start));
    let refused = &server.sensors()[0];
    assert_eq!(refused.error.as_ref().unwrap().kind, RefusalKind::Taken);
    // The server is held.
    server.compute();
    assert!(taken(&mut server, "bob").unwrap().contains("ada"));
    assert!(server.answers(Some("ada")) && !server.answers(Some("bob")));
    // The holder gets it again; other tools get it once the holder has not returned.
    server.evaluate(request(2));
    assert_eq!(server.jobs.len(), 1);
    server.compute();
    server.pass(Duration::from_secs(6));
    assert_eq!(taken(&mut server, "bob"), None);
    assert_eq!(server.jobs.len(), 1);
    // A run in stepwise mode takes it as well.
    let mut server = Server::of_walks();
    server.say(
        Topic::Parameters,
        &json!({"server": 7, "simulation_hash": "h"}),
    );
    server.say(
        Topic::Control,
        &json!({"server": 7, "simulation_hash": "h", "tool": "carl"}),
    );
    assert!(taken(&mut server, "bob").unwrap().contains("carl"));
    assert!(taken(&mut server, "carl").unwrap().contains("carl"));
}

#[test]
fn control_from_others_moves_nothing_and_from_the_holder_releases() {
    let control = |run: bool, tool: &str| json!({"server": 7, "simulation_hash": "h", "run": run, "tool": tool});
    let mut server = Server::of_walks();
    server.evaluate(request(1));
    server.evaluate(request(2));
    server.say(
        Topic::Parameters,
        &json!({"server": 7, "simulation_hash": "h"}),
    );
    server.say(Topic::Control, &control(true, "bob"));
    server.say(Topic::Control, &control(false, "bob"));
    server.say(
        Topic::Control,
        &json!({"server": 7, "simulation_hash": "h", "run": false}),
    );
    assert_eq!(server.jobs.len(), 1);
    assert!(!server.answers(Some("bob")));
    server.say(Topic::Control, &control(false, "ada"));
    // The current computation must stop first, and its result is not sent. A request that arrives meanwhile is next.
    assert!(!server.answers(None));
    let start = || ToServer::Start(batch(5));
    server.ask(start());
    let refused = server.sensors()[0].error.clone().unwrap();
    assert_eq!(refused.kind, RefusalKind::Taken);
    assert!(refused.reason.contains("given up"), "{refused:?}");
    assert_eq!(taken(&mut server, "bob"), None);
    assert!(taken(&mut server, "ada").unwrap().contains("bob"));
    server.replies.clear();
    server.compute();
    assert!(
        matches!(&server.replies[..], [(topic, ToTool::Evaluated(found))]
        if topic.ends_with("bob") && found.error.is_none() && found.request == 99)
    );
    // A held server is freed at once.
    assert!(!server.answers(None));
    server.say(Topic::Control, &control(false, "bob"));
    assert!(server.answers(None));
}

#[test]
fn a_connection_that_breaks_gives_the_work_up() {
    let mut server = Server::of_walks();
    server.evaluate(request(1));
    server.evaluate(request(2));
    server.machine.disconnected("gone", server.now);
    server.compute();
    assert!(server.replies.is_empty());
    assert!(server.answers(None));
}

#[test]
fn presence_says_who_has_the_server() {
    let mut server = Server::of_walks();
    server.evaluate(request(1));
    server.pass(Duration::from_millis(200));
    let (topic, payload) = server.published.pop().unwrap();
    let Message::Presence(presence) = Message::decode(topic, &payload).unwrap() else {
        panic!("{topic:?}")
    };
    assert_eq!(
        (presence.state, presence.tool.as_deref()),
        (State::Busy, Some("ada"))
    );
    let announced = presence.capabilities.swarmwright.unwrap();
    assert_eq!(announced.modes, ["stepwise", "batched", "offloaded"]);
    let (last, kinds) = announced.controllers.split_last().unwrap();
    assert_eq!(kinds, swarmwright_controllers::KINDS);
    assert_eq!(last, swarmwright_controllers::TEAM);
    assert_eq!(announced.batch, Some(256));
}

#[test]
fn a_server_in_whose_place_another_was_lost_says_again_since_when_it_is_there() {
    let mut server = Server::of_walks();
    let said = "2026-01-30T08:00:00Z";
    server.machine.publish_presence(said.to_owned());
    server.collect();
    let (topic, payload) = server.published.pop().unwrap();
    let mut other: Value = serde_json::from_slice(&payload).unwrap();
    other["state"] = json!("lost");
    other["since"] = json!("2001-01-01T00:00:00Z");
    other["capabilities"]["swarmwright"]["instance"] = json!("another");
    let name = Topics::default().presence(7);
    server.receive(&name, other.to_string().as_bytes());
    server.pass(Duration::ZERO);
    let (again, repeated) = server.published.pop().unwrap();
    assert_eq!((again, repeated), (topic, payload));
    // A changed state has a new time.
    server.evaluate(request(1));
    server.pass(Duration::from_millis(200));
    let (_, payload) = server.published.pop().unwrap();
    let busy: Value = serde_json::from_slice(&payload).unwrap();
    assert_eq!(busy["since"], json!("2026-01-31T12:00:00Z"));
}

#[test]
fn what_cannot_be_served_is_refused_with_the_field_that_is_wrong() {
    let mut server = Server::of_walks();
    let change = |edit: &dyn Fn(&mut Evaluate)| {
        let mut message = request(4);
        edit(&mut message);
        message
    };
    let with = |key: &'static str, value: Value| {
        change(&move |message| {
            message.controller.insert(key.to_owned(), value.clone());
        })
    };
    let cases = [
        (
            change(&|m| m.simulation = "walc".into()),
            "simulation: \"walc\"",
        ),
        (with("kind", json!("oracle")), "controller.kind"),
        (with("sensors", json!(3)), "controller.sensors"),
        (with("actuators", json!(2)), "controller.actuators"),
        (with("colour", json!("red")), "controller.colour"),
        (change(&|m| m.genomes.0.truncate(5)), "genomes"),
        (change(&|m| m.genomes.0[3] = f32::NAN), "genomes"),
        (change(&|m| m.seeds.0.clear()), "seeds"),
        (change(&|m| m.seeds.0 = vec![1; 8_000_000]), "genomes"),
        (change(&|m| m.lease = f64::NAN), "lease"),
        (change(&|m| m.version = 2), "version"),
        (
            change(&|m| m.parameters = object(json!({"agents": "two"}))),
            "parameter agents",
        ),
    ];
    for (message, field) in cases {
        server.evaluate(message);
        server.compute();
        let [result] = &server.results()[..] else {
            panic!("{field}: one answer")
        };
        let refusal = result.error.as_ref().unwrap();
        assert_eq!(refusal.kind, RefusalKind::Invalid, "{refusal:?}");
        assert!(refusal.reason.contains(field), "{field}: {refusal:?}");
        assert_eq!((result.request, result.fitness.0.len()), (4, 0));
        assert!(server.answers(Some("ada")), "{field}: usable");
    }
    server.evaluate(request(5));
    server.compute();
    assert_eq!(server.results()[0].fitness.0.len(), 4);
}

#[test]
fn nothing_asked_is_nothing_answered_at_once() {
    let mut server = Server::of_walks();
    let mut message = request(1);
    message.genomes = F32s::default();
    server.evaluate(message);
    server.compute();
    let result = &server.results()[0];
    assert!(result.fitness.0.is_empty() && result.error.is_none());
}

#[test]
fn answers_go_to_topics_of_tools_alone() {
    let mut server = Server::of_walks();
    for reply in [
        "fitness",
        "swarmwright/v1/presence/7",
        "swarmwright/v1/tool/",
        "swarmwright/v1/tool/+",
        "swarmwright/v1/tool/a/b",
        "",
    ] {
        let mut message = request(1);
        message.reply = reply.to_owned();
        server.evaluate(message);
        let mut start = batch(1);
        start.reply = reply.to_owned();
        server.ask(ToServer::Start(start));
        assert!(
            server.jobs.is_empty() && server.replies.is_empty(),
            "{reply}"
        );
        assert!(server.answers(None), "{reply}");
    }
    assert_eq!(server.warnings.len(), 6);
}

#[test]
fn requests_for_other_servers_and_leftovers_are_not_read() {
    let mut server = Server::of_walks();
    let payload = ToServer::Evaluate(request(1)).encode();
    server.receive(&Topics::default().to_server(8), &payload);
    server
        .machine
        .receive(&Topics::default().to_server(7), &payload, true, server.now);
    server.collect();
    assert!(server.jobs.is_empty() && server.replies.is_empty());
}

#[test]
fn an_episode_that_fails_is_named_and_the_others_count() {
    for (trouble, reason) in [
        ("panic", "the simulation panicked: a wall came down"),
        ("fail", "no way on"),
        ("reset", "no start"),
        ("sensor", "sensors[1]"),
        ("fitness", "NaN"),
    ] {
        let mut server = Server::of_walks();
        let mut message = request(1);
        message.seeds = U64s(vec![2, 3, 4]);
        let healthy = expected(&message);
        message.parameters = object(json!({"trouble": trouble}));
        server.evaluate(message);
        server.compute();
        let result = server.results().remove(0);
        for (index, fitness) in result.fitness.0.iter().enumerate() {
            if index % 3 == 1 {
                assert!(fitness.is_nan(), "{trouble}");
            } else {
                assert_eq!(fitness.to_bits(), healthy[index].to_bits(), "{trouble}");
            }
        }
        let named: Vec<(u64, u64)> = result
            .failed
            .iter()
            .map(|failure| (failure.candidate, failure.episode))
            .collect();
        assert_eq!(named, [(0, 1), (1, 1)], "{trouble}");
        assert!(
            result.failed[0].reason.contains(reason),
            "{:?}",
            result.failed
        );
        // The server works as before.
        server.evaluate(request(2));
        server.compute();
        assert_eq!(
            bits(&server.results()[0].fitness.0),
            bits(&expected(&request(2)))
        );
    }
}

#[test]
fn the_simulation_asked_for_is_used_where_several_are_offered() {
    let walk = Walk::default();
    let mut server = Server::new(vec![Box::<Minisim>::default(), Box::new(walk)]);
    server.evaluate(request(1));
    server.compute();
    assert_eq!(
        bits(&server.results()[0].fitness.0),
        bits(&expected(&request(1)))
    );
    let mut message = request(2);
    message.simulation = "minisim".to_owned();
    let mut controller = network();
    controller.insert("sensors".to_owned(), 4.into());
    message.controller = controller;
    message.genomes = F32s(vec![0.0; 5]);
    server.evaluate(message);
    server.compute();
    assert_eq!(server.results()[0].fitness.0, [zeros(); 2]);
}

/// Returns the fitness of a network of zeros in the published example.
fn zeros() -> f64 {
    let controller = object(
        json!({"version": 1, "kind": "layered", "sensors": 4, "actuators": 1, "hidden": [],
        "activation": "tanh", "output_range": [-1, 1]}),
    );
    let architecture = Arc::new(architecture(&controller));
    let controller = Controller::with_weights(&architecture, vec![0.0; 5].into()).unwrap();
    rollout(
        &mut Minisim::default(),
        &serde_json::Map::new(),
        &controller,
    )
    .unwrap()
}

#[test]
fn presence_waits_for_the_connection_to_come_back() {
    let mut server = Server::of_walks();
    server
        .machine
        .publish_presence("2026-01-31T12:00:00Z".to_owned());
    server.collect();
    server.published.clear();
    server.machine.disconnected("gone", server.now);
    assert_eq!(server.machine.next_tick(), None);
    server.pass(Duration::from_secs(1));
    assert!(server.published.is_empty(), "it could not be sent");
    server
        .machine
        .connected("2026-01-31T12:00:01Z".to_owned(), server.now);
    server.collect();
    assert!(
        server.published.is_empty(),
        "another server may have the id by now"
    );
    server.pass(Duration::from_millis(100));
    let (topic, payload) = server.published.pop().unwrap();
    let Message::Presence(presence) = Message::decode(topic, &payload).unwrap() else {
        panic!("{topic:?}")
    };
    assert_eq!(
        presence.state,
        State::Ready,
        "in the place of the last will"
    );
}

/// Returns a sample of 300 candidates for the walk's network.
fn sample() -> Sample {
    let row = |value: f64| F64s(vec![value; 3]);
    Sample {
        distribution: NORMAL.to_owned(),
        seed: u64::MAX,
        purpose: "test.direction".to_owned(),
        generation: 3,
        first: 5,
        count: 300,
        mirrored: true,
        center: F64s(vec![0.1, -0.5, 0.0]),
        deviation: F64s(vec![0.5, 0.25, 1.0]),
        middle: row(0.0),
        reach: row(1.0),
        lower: row(-2.0),
        upper: row(2.0),
    }
}

fn sampled(number: u64, sample: Sample) -> Evaluate {
    Evaluate {
        genomes: F32s::default(),
        sample: Some(Box::new(sample)),
        ..request(number)
    }
}

#[test]
fn the_genomes_of_a_sample_are_made_by_the_server() {
    let sample = sample();
    let gaussian = GaussianSample {
        seed: sample.seed,
        purpose: &sample.purpose,
        generation: sample.generation,
        mirrored: sample.mirrored,
        center: &sample.center.0,
        deviation: &sample.deviation.0,
        scale: Scale {
            middle: &sample.middle.0,
            reach: &sample.reach.0,
            lower: &sample.lower.0,
            upper: &sample.upper.0,
        },
    };
    let mut genomes = vec![0.0; 300 * 3];
    gaussian.genomes(sample.first, &mut genomes);
    let by_weights = Evaluate {
        genomes: F32s(genomes),
        ..request(2)
    };
    let mut server = Server::of_walks();
    server.evaluate(sampled(1, sample));
    server.evaluate(by_weights.clone());
    server.compute();
    let results = server.results();
    assert_eq!(results.len(), 2);
    let expected = expected(&by_weights);
    assert!(expected.iter().any(|fitness| *fitness != expected[0]));
    for result in results {
        assert_eq!(bits(&result.fitness.0), bits(&expected));
        assert!(result.failed.is_empty() && result.error.is_none());
    }
}

#[test]
fn a_sample_that_cannot_be_made_is_refused() {
    type Change = fn(&mut Sample);
    let changes: [(Change, &str); 8] = [
        (
            |sample| sample.distribution = "cauchy".to_owned(),
            "sample.distribution: \"cauchy\" is unknown here, only normal",
        ),
        (
            |sample| {
                *sample = Sample {
                    center: F64s(vec![0.0; 2]),
                    deviation: F64s(vec![0.0; 2]),
                    middle: F64s(vec![0.0; 2]),
                    reach: F64s(vec![0.0; 2]),
                    lower: F64s(vec![0.0; 2]),
                    upper: F64s(vec![0.0; 2]),
                    ..sample.clone()
                }
            },
            "sample.center: 2 numbers, but the controller has 3 weights",
        ),
        (
            |sample| sample.deviation.0.truncate(2),
            "\"sample.deviation\" has 2 numbers",
        ),
        (
            |sample| sample.center.0[1] = f64::INFINITY,
            "\"sample.center\"[1] is inf",
        ),
        (
            |sample| sample.lower.0[2] = -1e39,
            "\"sample.lower\"[2] is -1",
        ),
        (
            |sample| sample.count = 1 << 40,
            "\"sample.count\" is 1099511627776: more genomes than",
        ),
        (|sample| sample.count = 5_000_000, "too many for one answer"),
        (
            |sample| sample.first = u64::MAX,
            "\"sample.first\" is too large",
        ),
    ];
    for (change, expected) in changes {
        let mut server = Server::of_walks();
        let mut sample = sample();
        change(&mut sample);
        server.evaluate(sampled(1, sample));
        server.compute();
        let results = server.results();
        let error = results[0].error.as_ref().unwrap();
        assert_eq!(error.kind, RefusalKind::Invalid);
        assert!(error.reason.contains(expected), "{}", error.reason);
    }
    let mut server = Server::of_walks();
    server.evaluate(Evaluate {
        sample: Some(Box::new(sample())),
        ..request(1)
    });
    let results = server.results();
    let error = results[0].error.as_ref().unwrap();
    assert!(
        error.reason.contains("where there is a \"sample\""),
        "{}",
        error.reason
    );
}
