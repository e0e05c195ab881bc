//! NEAT on the problems of Stanley and Miikkulainen (Evolutionary Computation 10, 2002): XOR, and balancing two poles with and without
//! velocities. Prints a JSON list of the evaluations that each run took; null: it failed.
//!
//! `cargo run --release --example neat -- xor|velocities|positions [RUNS] [FIRST SEED]`
#![expect(
    clippy::unwrap_used,
    clippy::cast_precision_loss,
    reason = "a program for developers"
)]

mod poles;

use std::sync::Arc;

use poles::Poles;
use rayon::prelude::*;
use serde_json::json;
use swarmwright_controllers::{Architecture, Controller};
use swarmwright_evolution::{
    Compatibility, GrowingNetwork, Neat, NeatSettings, Search, Stream, WeightMutation, purpose_key,
};

/// A problem with the paper's settings.
struct Problem {
    sensors: usize,
    recurrent: bool,
    population: usize,
    add_connection: f64,
    /// Coefficient of weights, and threshold.
    species: (f64, f64),
    /// Share of a species that may be parents, and greatest change of a weight: those of the authors' files of parameters.
    parents: (f64, f64),
    /// Fitness, and whether it may be a solution.
    evaluate: fn(&mut Controller) -> (f64, bool),
    /// Whether the best network of a generation is a solution.
    is_solution: fn(&mut Controller) -> bool,
    generations: usize,
}

const XOR: Problem = Problem {
    sensors: 2,
    recurrent: false,
    population: 150,
    add_connection: 0.05,
    species: (0.4, 3.0),
    parents: (0.2, 2.5),
    evaluate: xor,
    is_solution: |_| true,
    generations: 200,
};

/// Balancing for 100,000 steps.
const VELOCITIES: Problem = Problem {
    sensors: 6,
    evaluate: |controller| {
        let steps = Poles::new(0.07).balance(controller, Poles::with_velocities, 100_000);
        (steps as f64, steps == 100_000)
    },
    ..XOR
};

/// Balancing with Gruau's fitness; a solution balances for 100,000 steps, and from 200 of 625 other states for 1,000.
const POSITIONS: Problem = Problem {
    sensors: 3,
    population: 1000,
    add_connection: 0.3,
    species: (3.0, 4.0),
    parents: (0.4, 1.8),
    recurrent: true,
    evaluate: |controller| (Poles::new(0.07).gruau(controller), true),
    is_solution: |controller| {
        Poles::new(0.07).balance(controller, Poles::positions, 100_000) == 100_000
            && Poles::generalization(controller) >= 200
    },
    ..VELOCITIES
};

/// All four cases: the square of 4 minus the errors.
fn xor(controller: &mut Controller) -> (f64, bool) {
    let (mut errors, mut right) = (0.0, true);
    for (inputs, expected) in [
        ([0.0, 0.0], 0.0),
        ([0.0, 1.0], 1.0),
        ([1.0, 0.0], 1.0),
        ([1.0, 1.0], 0.0),
    ] {
        let mut actuators = [0.0];
        controller.reset();
        controller.step(&inputs, &mut actuators).unwrap();
        let output = (f64::from(actuators[0]) + 1.0) / 2.0;
        errors += (output - expected).abs();
        right &= (output > 0.5) == (expected > 0.5);
    }
    ((4.0 - errors).powi(2), right)
}

/// Evaluations until the first solution.
fn solve(problem: &Problem, seed: u64) -> Option<usize> {
    let operators = GrowingNetwork {
        sensors: problem.sensors,
        actuators: 1,
        nodes: 30,
        connections: 120,
        recurrent: problem.recurrent,
        activations: vec![0],
        last_activation: 5,
        weight_range: 1.0,
        add_node: 0.03,
        add_connection: problem.add_connection,
        toggle: 0.0,
    };
    let architecture = json!({"version": 1, "kind": "growing", "sensors": problem.sensors, "actuators": 1, "nodes": 30,
        "connections": 120, "recurrent": problem.recurrent, "output_activation": "steep_sigmoid", "output_range": [0, 1]});
    let architecture = Arc::new(Architecture::from_json(&architecture.to_string()).unwrap());
    let settings = NeatSettings {
        compatibility: Compatibility {
            disjoint: 1.0,
            weights: problem.species.0,
        },
        threshold: problem.species.1,
        species: None,
        survival: problem.parents.0,
        stagnation: 15,
        mutate_only: 0.25,
        interspecies: 0.001,
        weights: WeightMutation {
            genomes: 0.8,
            each: 0.7,
            severity: problem.parents.1,
        },
    };
    let genes = operators.genes();
    let mut first = vec![0.0; problem.population * genes];
    for (member, genome) in (0..).zip(first.chunks_exact_mut(genes)) {
        operators.initial(
            &mut Stream::new(seed, purpose_key("initial"), 0, member),
            genome,
        );
    }
    let mut search = Neat::new((seed, "neat"), first, operators, settings);
    for generation in 0..problem.generations {
        let genomes = search.ask().ok()?;
        let controller =
            |genome: &[f32]| Controller::with_weights(&architecture, genome.into()).unwrap();
        let (mut fitness, mut solved) = (Vec::new(), None);
        let mut best = 0;
        for (member, genome) in genomes.chunks_exact(genes).enumerate() {
            let (value, may_solve) = (problem.evaluate)(&mut controller(genome));
            fitness.push(value);
            best = if value > fitness[best] { member } else { best };
            if may_solve && solved.is_none() {
                solved = Some(member);
            }
        }
        let tested = if problem.population == 1000 {
            best
        } else {
            solved.unwrap_or(0)
        };
        if solved.is_some()
            && (problem.is_solution)(&mut controller(&genomes[tested * genes..][..genes]))
        {
            return Some(generation * problem.population + tested + 1);
        }
        search.tell(&genomes, &fitness).ok()?;
    }
    None
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let problem = match arguments.first().map(String::as_str) {
        Some("velocities") => VELOCITIES,
        Some("positions") => POSITIONS,
        _ => XOR,
    };
    let number = |index: usize, default: u64| {
        arguments
            .get(index)
            .map_or(default, |text| text.parse().unwrap())
    };
    let (runs, first) = (number(1, 100), number(2, 1));
    let results: Vec<Option<usize>> = (first..first + runs)
        .into_par_iter()
        .map(|seed| solve(&problem, seed))
        .collect();
    println!("{}", json!(results));
}
