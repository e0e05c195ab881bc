//! Deterministic simulation testing of pools and servers under seeded schedules of faults. `SWARMWRIGHT_SCHEDULES` says how many,
//! `SWARMWRIGHT_FIRST_SEED` from which seed on; `make schedules` runs many more.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

use std::collections::BTreeSet;
use std::path::Path;

use swarmwright_schedules::scale::{Scale, simulate};
use swarmwright_schedules::{Schedule, check, draw, shrink, survey};

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

#[test]
fn every_schedule_leaves_every_property() {
    let (first, count) = (
        number("SWARMWRIGHT_FIRST_SEED", 1),
        number("SWARMWRIGHT_SCHEDULES", 2000),
    );
    let found = survey(first, count, 1, 1);
    println!("{found}");
    assert!(found.failures.is_empty(), "{}", found.failures.join("\n"));
    assert!(
        found.scored > count && found.events > 100 * count,
        "{found}"
    );
}

#[test]
fn no_server_hears_control_messages_for_another_one() {
    for servers in [10, 100] {
        let figures = simulate(
            &Scale {
                seed: 1,
                servers,
                episode: 1_000_000,
                preempted_after: Some(60_000_000),
                share: 4,
                generations: 1,
            },
            &|| 0,
        )
        .unwrap();
        let [discovery, control, own] = figures.heard_per_second;
        assert_eq!(control, 0.0, "{servers} servers");
        assert!(discovery > 0.0 && own > 0.0, "{figures:?}");
    }
}

/// They end, although they are longer than what servers are given for a step by default.
#[test]
fn episodes_of_minutes_are_waited_for() {
    let figures = simulate(
        &Scale {
            seed: 1,
            servers: 10,
            episode: 600_000_000,
            preempted_after: None,
            share: 4,
            generations: 1,
        },
        &|| 0,
    )
    .unwrap();
    assert_eq!(figures.evaluations, 40);
    assert!(
        figures.lost == 0.0 && figures.utilisation > 0.5,
        "{figures:?}"
    );
    assert!(!figures.counts.contains_key("time_outs"), "{figures:?}");
}

/// Schedules that once broke a property, as small as they could be made; the file's name says what was wrong.
#[test]
fn regressions_stay_fixed() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("regressions");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let schedule: Schedule = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        let report = check(&schedule, false);
        assert_eq!(report.violation, None, "{}\n{schedule}", path.display());
        count += 1;
    }
    assert!(count > 0);
}

#[test]
fn the_same_schedule_gives_the_same_events() {
    for seed in 1..100 {
        let schedule = draw(seed);
        let [first, second] = [(); 2].map(|()| check(&schedule, false));
        assert_eq!(first.fingerprint, second.fingerprint, "seed {seed}");
        assert_eq!(first.events, second.events, "seed {seed}");
    }
}

#[test]
fn all_that_can_happen_is_drawn() {
    let mut seen = BTreeSet::new();
    for seed in 1..500 {
        let schedule = draw(seed);
        let json: serde_json::Value = serde_json::to_value(&schedule).unwrap();
        let back: Schedule = serde_json::from_value(json.clone()).unwrap();
        assert_eq!(back, schedule);
        for disturbance in json["disturbances"].as_array().unwrap() {
            seen.extend(disturbance["what"].as_object().unwrap().keys().cloned());
        }
        for tool in &schedule.tools {
            seen.insert(tool.mode.clone());
            seen.extend(tool.works.iter().map(|work| format!("{:?}", work.kind)));
            seen.extend(
                tool.works
                    .iter()
                    .filter(|work| work.window.is_some())
                    .map(|_| "streaming".to_owned()),
            );
        }
    }
    let wanted = [
        "FullyMeshed",
        "Layered",
        "ParameterSet",
        "auto",
        "batched",
        "break",
        "broker",
        "crash",
        "cross",
        "cut",
        "delay",
        "duplicate",
        "freeze",
        "interrupt",
        "leave",
        "lose",
        "offloaded",
        "partition",
        "reorder",
        "restart",
        "slow",
        "stepwise",
        "streaming",
    ];
    assert_eq!(seen.iter().map(String::as_str).collect::<Vec<_>>(), wanted);
}

/// Work that no server can do, hidden among much that plays no part.
#[test]
fn what_fails_is_made_small() {
    let mut schedule = (1..)
        .map(draw)
        .filter(|schedule| !schedule.to_string().contains("is killed"))
        .find(|schedule| schedule.disturbances.len() > 6)
        .unwrap();
    schedule.tools[0].mode = "offloaded".to_owned();
    for server in &mut schedule.servers {
        server.plain = true;
    }
    let (small, report) = shrink(&schedule);
    assert!(report.violation.unwrap().contains("waits for ever"));
    assert_eq!(small.disturbances, []);
    assert_eq!(
        (
            small.servers.len(),
            small.tools.len(),
            small.tools[0].works.len()
        ),
        (1, 1, 1)
    );
    assert_eq!(small.tools[0].works[0].candidates, 1);
}
