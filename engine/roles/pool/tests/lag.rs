//! Steps that take as long as delayed acknowledgements.

use crate::common;

use std::time::Duration;

use common::{Net, Party, tool, work};

const URL: &str = "mqtt://broker:1883";

/// Returns the warnings of a run with steps of this many milliseconds after the probe of the broker, and the number of
/// probes.
fn told(step: f64, answer: Result<bool, String>) -> (Vec<String>, usize) {
    let mut net = Net::new(3);
    let server = net.add_seed_only(7);
    let tool = net.add(Party::Tool(Box::new(tool("a", 0, net.now))));
    net.submit(tool, work(20, &[3]));
    let mut count = 0;
    while !net.tool(tool).finished() {
        let idle = net.idle(server);
        net.turn();
        let last = net.log.last().map(|message| message.topic.as_str());
        if idle && !net.idle(server) && matches!(last, Some("control" | "actuator")) {
            net.now += Duration::from_secs_f64(step / 1e3);
        }
        if net.asked > count {
            count = net.asked;
            net.tool(tool).broker_holds_back(answer.clone(), URL);
            net.collect(tool);
        }
    }
    (net.warnings, net.asked)
}

#[test]
fn a_broker_that_holds_small_packets_back_is_told_once() {
    let (warnings, asked) = told(44.0, Ok(true));
    assert_eq!(asked, 1);
    let [warning] = &warnings[..] else {
        panic!("{warnings:?}")
    };
    for part in [
        "the broker at mqtt://broker:1883 holds small packets back",
        "20 answers of server 7 took 44 ms each",
        "set_tcp_nodelay true",
    ] {
        assert!(warning.contains(part), "{warning}");
    }
}

#[test]
fn a_simulation_that_takes_as_long_is_none_of_the_brokers_business() {
    assert_eq!(told(40.0, Ok(false)), (vec![], 1));
}

#[test]
fn it_is_said_where_it_cannot_be_found_out() {
    let (warnings, _) = told(44.0, Err("no more clients".into()));
    assert_eq!(warnings.len(), 1);
    assert!(
        warnings[0].contains("could not be determined: no more clients"),
        "{warnings:?}"
    );
}

#[test]
fn the_broker_is_not_asked_where_steps_take_another_time() {
    for step in [0.2, 10.0, 62.0, 150.0] {
        assert_eq!(told(step, Ok(true)), (vec![], 0), "{step} ms");
    }
}
