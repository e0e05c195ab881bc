//! Servers that generate the genomes of a sample themselves, and others that receive the genomes.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test")]

use crate::common;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use common::{ARCHITECTURE, Line, Net, Party, SEEDS, begin, begin_with, offloaded, server};
use proptest::prelude::*;
use serde_json::{Map, Value, json};
use swarmwright_controllers::Architecture;
use swarmwright_evolution::{GaussianSample, Scale};
use swarmwright_pool::{Faults, Mode, Work, WorkError};
use swarmwright_protocol::{F64s, NORMAL, Sample, ToServer};

const CANDIDATES: usize = 200;
const WEIGHTS: usize = 3;

fn sample(seed: u64, mirrored: bool) -> Sample {
    let row = |value: f64| F64s(vec![value; WEIGHTS]);
    Sample {
        distribution: NORMAL.to_owned(),
        seed,
        purpose: "test.direction".to_owned(),
        generation: 7,
        first: 0,
        count: CANDIDATES as u64,
        mirrored,
        center: F64s(vec![0.5, -0.25, 0.125]),
        deviation: F64s(vec![0.5, 0.25, 2.0]),
        middle: row(0.1),
        reach: row(1.5),
        lower: row(-3.0),
        upper: row(2.0),
    }
}

/// Generates the genomes of a sample.
fn genomes(sample: &Sample) -> Vec<f32> {
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
    let count = usize::try_from(sample.count).unwrap();
    let mut genomes = vec![0.0; count * sample.center.0.len()];
    gaussian.genomes(sample.first, &mut genomes);
    genomes
}

fn by_weights(sample: &Sample) -> Work {
    Work::new(ARCHITECTURE, genomes(sample), SEEDS.to_vec()).unwrap()
}

/// Creates work from a sample; `drawn`: the genomes are generated only when needed.
fn by_numbers(sample: &Sample, drawn: bool) -> Work {
    if !drawn {
        return by_weights(sample).sampled(sample.clone()).unwrap();
    }
    let (architecture, specification) = controller();
    Work::drawn(
        architecture,
        specification,
        sample.clone(),
        genomes,
        SEEDS.to_vec(),
    )
    .unwrap()
}

fn controller() -> (Architecture, Map<String, Value>) {
    (
        Architecture::from_json(ARCHITECTURE).unwrap(),
        serde_json::from_str(ARCHITECTURE).unwrap(),
    )
}

/// Returns the results if all genomes are sent.
fn expected(sample: &Sample) -> Vec<f64> {
    let mut net = Net::new(0);
    net.add(Party::Server(Box::new(server(1, Line::new()))));
    let index = begin(&mut net, Mode::Offloaded, by_weights(sample));
    net.finish(index)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn results_do_not_depend_on_who_makes_the_genomes(
        making in 0u64..4, others in 0u64..3, seed_only in 0u64..2, seed: u64, mirrored: bool, random: u64, drawn: bool,
    ) {
        prop_assume!(making + others + seed_only > 0);
        let sample = sample(seed, mirrored);
        let mut net = Net::new(random);
        for id in 30..30 + making {
            net.add(Party::Server(Box::new(server(id, Line::new()))));
        }
        for id in 20..20 + others {
            net.add(Party::Extended(Box::new(offloaded(id))));
        }
        for id in 0..seed_only {
            net.add_seed_only(id);
        }
        let index = begin(&mut net, Mode::Auto, by_numbers(&sample, drawn));
        prop_assert_eq!(net.finish(index), expected(&sample));
        prop_assert!(net.warnings.is_empty(), "{:?}", net.warnings);
    }

    #[test]
    fn a_server_lost_with_a_part_of_a_sample_costs_nothing_but_time(
        after in 0usize..120, seed: u64, mirrored: bool, random: u64, drawn: bool,
    ) {
        let sample = sample(seed, mirrored);
        let mut net = Net::new(random);
        let doomed = net.add(Party::Server(Box::new(server(30, Line::new()))));
        net.add(Party::Server(Box::new(server(31, Line::new()))));
        net.add(Party::Extended(Box::new(offloaded(20))));
        let index = begin(&mut net, Mode::Auto, by_numbers(&sample, drawn));
        for _ in 0..after {
            net.turn();
        }
        net.parties[doomed] = Party::Gone;
        prop_assert_eq!(net.finish(index), expected(&sample));
    }

    #[test]
    fn an_audit_finds_no_difference_between_a_sample_and_its_genomes(
        seed: u64, mirrored: bool, random: u64, drawn: bool,
    ) {
        let sample = sample(seed, mirrored);
        let mut net = Net::new(random);
        net.add(Party::Server(Box::new(server(30, Line::new()))));
        net.add(Party::Server(Box::new(server(31, Line::new()))));
        net.add(Party::Extended(Box::new(offloaded(20))));
        let faults = Faults { audit: 0.3, ..Faults::default() };
        let index = begin_with(&mut net, faults, by_numbers(&sample, drawn));
        prop_assert_eq!(net.finish(index), expected(&sample));
        let counts = *net.tool(index).counts();
        prop_assert!(counts.audits > 0 && counts.disagreements == 0, "{counts:?}");
    }
}

#[test]
fn a_sample_of_other_candidates_or_genes_is_refused() {
    let sample = sample(1, true);
    let other = |change: fn(&mut Sample)| {
        let mut other = sample.clone();
        change(&mut other);
        by_weights(&sample).sampled(other).unwrap_err()
    };
    for (error, expected) in [
        (
            other(|sample| sample.count += 2),
            "202 candidates of 3 genes, but there are 200 of 3",
        ),
        (
            other(|sample| sample.center.0.push(1.0)),
            "200 candidates of 4 genes",
        ),
        (
            other(|sample| sample.reach.0[1] = f64::NAN),
            "\"sample.reach\"[1] is NaN",
        ),
        (
            other(|sample| sample.upper.0[0] = 1e39),
            "\"sample.upper\"[0]",
        ),
    ] {
        assert!(matches!(error, WorkError::Sample(_)), "{error}");
        assert!(error.to_string().contains(expected), "{error}");
    }
}

#[test]
fn parts_of_a_sample_are_addressed_by_their_numbers_and_few_candidates_travel_as_genomes() {
    for drawn in [false, true] {
        let work = by_numbers(&sample(1, true), drawn);
        let part = work.sample_of(&(21..90)).unwrap();
        assert_eq!((part.first, part.count), (21, 69));
        assert!(work.sample_of(&(5..10)).is_none());
        let mut longer = work.clone();
        longer.extend(&[0.0; WEIGHTS]).unwrap();
        assert!(longer.sample_of(&(21..90)).is_none(), "not all are of it");
    }
}

#[test]
fn genomes_that_are_made_when_they_are_needed_are_those_of_the_sample() {
    let sample = sample(1, true);
    let (all, mut work) = (genomes(&sample), by_numbers(&sample, true));
    assert_eq!(
        (work.candidates(), work.len()),
        (CANDIDATES, SEEDS.len() * CANDIDATES)
    );
    assert_eq!(work.genomes_of(7..50)[..], all[7 * WEIGHTS..50 * WEIGHTS]);
    work.forget_before(20);
    assert_eq!(work.genomes_of(21..22)[..], all[21 * WEIGHTS..22 * WEIGHTS]);
    let more = [1.0, 2.0, 3.0];
    work.extend(&more).unwrap();
    assert_eq!(work.candidates(), CANDIDATES + 1);
    assert_eq!(
        work.genomes_of(199..201)[..],
        [&all[199 * WEIGHTS..], &more].concat()
    );
    work.forget_before(200);
    assert_eq!(work.into_genomes(), more);
}

#[test]
fn a_sample_for_other_controllers_is_refused_without_genomes() {
    let mut sample = sample(1, true);
    sample.center.0.push(1.0);
    let (architecture, specification) = controller();
    let refused = Work::drawn(architecture, specification, sample, genomes, vec![1]);
    let error = refused.unwrap_err().to_string();
    assert!(error.contains("200 candidates of 4 genes"), "{error}");
}

#[test]
fn only_servers_that_announce_the_distribution_get_samples() {
    let sample = sample(3, true);
    let mut net = Net::new(5);
    net.add(Party::Server(Box::new(server(30, Line::new()))));
    net.add(Party::Extended(Box::new(offloaded(20))));
    let index = begin(&mut net, Mode::Offloaded, by_numbers(&sample, false));
    net.finish(index);
    let mut samples = [0, 0];
    for common::Message { topic, payload, .. } in &net.log {
        if let Ok(ToServer::Evaluate(message)) = ToServer::decode(payload) {
            let made = usize::from(topic.ends_with("/30"));
            assert!(message.sample.is_none() || made == 1, "{topic}");
            samples[made] += usize::from(message.sample.is_some());
        }
    }
    assert!(samples[1] > 0);
}

#[test]
fn genomes_and_refusals_are_those_of_the_vectors() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../protocol/vectors/samples.json"
    );
    let vectors: Vec<Value> = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    for vector in &vectors {
        let bytes = STANDARD.decode(vector["bytes"].as_str().unwrap()).unwrap();
        let decoded = ToServer::decode(&bytes);
        assert_eq!(decoded.is_ok(), vector["accept"] == true, "{vector}");
        let Ok(ToServer::Evaluate(message)) = decoded else {
            continue;
        };
        let sample = message.sample.unwrap();
        let found: Vec<Vec<String>> = genomes(&sample)
            .chunks(sample.center.0.len())
            .map(|genome| {
                let bits = genome.iter().map(|gene| gene.to_bits());
                bits.map(|bits| format!("{bits:08x}")).collect()
            })
            .collect();
        assert_eq!(json!(found), vector["genomes"], "{}", vector["name"]);
    }
    assert!(vectors.len() >= 14);
}
