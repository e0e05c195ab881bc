//! Measures the round trip of an evaluation through the embedded broker, compared to that of a bare message.
//!
//! `cargo run --release -p swarmwright-wrapper --example offloaded`
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a measurement, for people to read

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::json;
use swarmwright_broker::{Broker, Config};
use swarmwright_controllers::Architecture;
use swarmwright_mqtt::{Connection, Event, PublishOptions, QoS, Settings, Subscription};
use swarmwright_protocol::{
    EXTENSION_VERSION, Evaluate, F32s, MEDIA_TYPE, ToServer, ToTool, Topics, U64s,
};
use swarmwright_worlds::{Block, Means, create, evaluate};
use swarmwright_wrapper::{Options, SimulationServer};

const REPLY: &str = "swarmwright/v1/tool/measure";

fn open(url: &str, filters: &[&str]) -> Connection {
    let subscriptions = filters
        .iter()
        .map(|filter| Subscription {
            filter: (*filter).to_owned(),
            qos: QoS::AtMostOnce,
        })
        .collect();
    Connection::open(Settings::new(url.parse().unwrap()), subscriptions).unwrap()
}

/// Waits for `count` messages and returns the last one.
fn wait(connection: &mut Connection, count: usize) -> Vec<u8> {
    let (mut received, mut last) = (0, Vec::new());
    let mut events = Vec::new();
    while received < count {
        connection.poll(Instant::now() + Duration::from_secs(10), &mut events);
        for event in events.drain(..) {
            if let Event::Message(message) = event {
                received += 1;
                last = message.payload().to_vec();
            }
        }
    }
    last
}

fn request(candidates: usize) -> Vec<u8> {
    let controller = json!({"version": 1, "kind": "layered", "sensors": 4, "actuators": 1, "hidden": [8],
        "activation": "tanh", "output_range": [-1, 1]});
    ToServer::Evaluate(Evaluate {
        version: EXTENSION_VERSION,
        request: 1,
        tool: "measure".to_owned(),
        reply: REPLY.to_owned(),
        simulation: "minisim".to_owned(),
        parameters: serde_json::Map::new(),
        controller: controller.as_object().unwrap().clone(),
        genomes: genomes(candidates),
        seeds: U64s(vec![1]),
        metrics: Vec::new(),
        attempt: 1,
        lease: 60.0,
        instance: None,
        sample: None,
    })
    .encode()
}

fn genomes(candidates: usize) -> F32s {
    F32s(
        (0..candidates * 49)
            .map(|i| (i as f32 * 0.37).sin())
            .collect(),
    )
}

/// Returns the median round-trip time in seconds.
fn there_and_back(connection: &mut Connection, topic: &str, payload: &[u8], rounds: usize) -> f64 {
    let options = PublishOptions {
        content_type: Some(MEDIA_TYPE),
        response_topic: Some(REPLY),
        correlation: Some(&[0; 8]),
        ..PublishOptions::default()
    };
    let mut times: Vec<f64> = (0..rounds)
        .map(|_| {
            let start = Instant::now();
            let sent = connection.publish_with(topic, payload, &options);
            assert!(sent.is_ok(), "below the largest packet");
            wait(connection, 1);
            start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[rounds / 2]
}

fn main() {
    let broker = Broker::start(&Config::default()).unwrap();
    let going = Arc::new(AtomicBool::new(true));
    let echo = {
        let (going, mut connection) = (Arc::clone(&going), open(&broker.url(), &["ping"]));
        thread::spawn(move || {
            let mut events = Vec::new();
            while going.load(Ordering::Relaxed) {
                connection.poll(Instant::now() + Duration::from_millis(100), &mut events);
                for event in events.drain(..) {
                    if let Event::Message(message) = event {
                        connection.publish(REPLY, message.payload(), QoS::AtMostOnce, false, None);
                    }
                }
            }
        })
    };
    let server = SimulationServer::connect(
        vec![create("minisim").unwrap()],
        Options::new(1, &broker.url()).unwrap(),
    )
    .unwrap();
    let serving = {
        let going = Arc::clone(&going);
        thread::spawn(move || server.run(|_| {}, || going.load(Ordering::Relaxed)))
    };
    let mut tool = open(&broker.url(), &[REPLY]);
    let inbox = Topics::default().to_server(1);
    for round in 0..5 {
        let bare = there_and_back(&mut tool, "ping", &[7; 200], 2000);
        print!("{round}: bare {:.1} us", bare * 1e6);
        for candidates in [0, 1, 16, 1000] {
            let time = there_and_back(&mut tool, &inbox, &request(candidates), 1000);
            print!(
                ", {candidates} candidates {:.1} us ({:.2} x)",
                time * 1e6,
                time / bare
            );
        }
        println!();
    }
    for window in [2, 16, 256] {
        let (payload, count) = (request(1), 20_000);
        let start = Instant::now();
        let mut sent = 0;
        while sent < count {
            for _ in 0..window {
                tool.publish(&inbox, &payload, QoS::AtMostOnce, false, None);
            }
            wait(&mut tool, window);
            sent += window;
        }
        println!(
            "{:.0} single evaluations/s, {window} at a time",
            sent as f64 / start.elapsed().as_secs_f64()
        );
    }
    let architecture = Architecture::from_json(
        r#"{"version": 1, "kind": "layered", "sensors": 4, "actuators": 1, "hidden": [8], "activation": "tanh",
            "output_range": [-1, 1]}"#,
    )
    .unwrap();
    for candidates in [20_000, 50_000] {
        let payload = request(candidates);
        let start = Instant::now();
        let message = ToServer::decode(&payload).unwrap();
        let read = start.elapsed();
        let start = Instant::now();
        assert_eq!(message.encode().len(), payload.len());
        println!(
            "{} bytes: read in {read:.1?}, written in {:.1?}",
            payload.len(),
            start.elapsed()
        );
        let genomes = genomes(candidates);
        let (mut inside, mut outside) = (Vec::new(), Vec::new());
        for _ in 0..7 {
            let start = Instant::now();
            let block = Block {
                architecture: &architecture,
                genomes: &genomes.0,
                parameters: &serde_json::Map::new(),
                seeds: &[1],
                metrics: &[],
                stop: None,
            };
            let means = Means {
                threads: 1,
                ..Means::default()
            };
            assert_eq!(
                evaluate("minisim", &block, means).unwrap().unwrap().len(),
                candidates
            );
            inside.push(start.elapsed().as_secs_f64());
            let start = Instant::now();
            // Two in flight: the next block waits while one is computed.
            let blocks = 4;
            tool.publish(&inbox, &payload, QoS::AtMostOnce, false, None);
            for block in 0..blocks {
                if block + 1 < blocks {
                    tool.publish(&inbox, &payload, QoS::AtMostOnce, false, None);
                }
                let ToTool::Evaluated(result) = ToTool::decode(&wait(&mut tool, 1)).unwrap() else {
                    return;
                };
                assert_eq!(result.fitness.0.len(), candidates);
            }
            outside.push(start.elapsed().as_secs_f64() / f64::from(blocks));
        }
        inside.sort_by(f64::total_cmp);
        outside.sort_by(f64::total_cmp);
        println!(
            "{candidates} candidates: in process {:.1} ms, offloaded {:.1} ms each: {:.2} of in-process speed",
            inside[3] * 1e3,
            outside[3] * 1e3,
            inside[3] / outside[3]
        );
    }
    going.store(false, Ordering::Relaxed);
    let _ = (echo.join(), serving.join());
}
