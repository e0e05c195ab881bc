//! Tests of the server's shell.

use std::collections::BTreeMap;

use swarmwright_protocol::{Evaluated, F64s, RefusalKind, ToTool};

use super::words::{lost, refusal};

#[test]
fn a_large_packet_before_the_end_of_a_connection_is_named() {
    assert_eq!(lost("closed".to_owned(), 0), "closed");
    let told = lost("closed".to_owned(), 9000);
    assert!(
        told.starts_with("closed, right after a packet of 9000 bytes"),
        "{told}"
    );
}

#[test]
fn an_answer_that_is_too_large_becomes_an_error() {
    let answer = ToTool::Evaluated(Evaluated {
        version: 1,
        request: 7,
        server: 3,
        fitness: F64s(vec![1.0; 1000]),
        metrics: BTreeMap::from([("steps".to_owned(), F64s(vec![2.0; 1000]))]),
        failed: Vec::new(),
        error: None,
        seconds: 0.5,
    });
    let instead = refusal(&answer.encode(), "too large".to_owned());
    assert!(instead.len() < 300);
    let Ok(ToTool::Evaluated(instead)) = ToTool::decode(&instead) else {
        panic!("another kind of answer");
    };
    assert_eq!((instead.request, instead.server), (7, 3));
    let error = instead.error.unwrap();
    assert_eq!(
        (error.kind, error.reason.as_str()),
        (RefusalKind::Failed, "too large")
    );
}
