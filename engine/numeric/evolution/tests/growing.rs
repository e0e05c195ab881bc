//! Networks that grow stay networks, and innovations have one number everywhere.

use std::collections::BTreeSet;

use proptest::prelude::*;
use swarmwright_evolution::{
    Compatibility, GrowingNetwork, Neat, NeatSettings, PatternFunction, Search, Stream,
    WeightMutation, purpose_key,
};

const WEIGHTS: WeightMutation = WeightMutation {
    genomes: 0.8,
    each: 1.0,
    severity: 2.5,
};

fn operators(recurrent: bool) -> GrowingNetwork {
    GrowingNetwork {
        sensors: 3,
        actuators: 2,
        nodes: 8,
        connections: 30,
        recurrent,
        activations: vec![0, 2],
        last_activation: 5,
        weight_range: 1.0,
        add_node: 0.4,
        add_connection: 0.5,
        toggle: 0.1,
    }
}

fn stream(purpose: &str, number: u64) -> Stream {
    Stream::new(7, purpose_key(purpose), 0, number)
}

fn grown(operators: &GrowingNetwork, seed: u64, mutations: u64) -> Vec<f32> {
    let mut genome = vec![0.0; operators.genes()];
    operators.initial(&mut stream("initial", seed), &mut genome);
    for mutation in 0..mutations {
        let mut child = vec![0.0; genome.len()];
        let mut own = Stream::new(seed, 1, mutation, 0);
        operators.mutated(&genome, &mut own, WEIGHTS, &mut child);
        genome = child;
    }
    genome
}

/// Markings of hidden nodes, and (source, target, weight, enabled) of connections.
type Decoded = (Vec<u32>, Vec<(usize, usize, f32, bool)>);

/// As a controller reads a genome; every number must be what the operators write.
fn decoded(operators: &GrowingNetwork, genome: &[f32]) -> Decoded {
    let hidden = genome[0] as usize;
    let nodes = &genome[1 + operators.actuators..][..3 * operators.nodes];
    let mut connections = genome[1 + operators.actuators + nodes.len()..].chunks_exact(3);
    let first = operators.sensors + 1 + operators.actuators;
    let counts = (0..hidden).map(|node| (first + node, nodes[3 * node + 2]));
    let actuators =
        (0..operators.actuators).map(|node| (operators.sensors + 1 + node, genome[1 + node]));
    let mut genes = Vec::new();
    for (target, count) in counts.chain(actuators) {
        for numbers in connections.by_ref().take(count as usize) {
            assert!(
                numbers[0].fract() == 0.0 && (numbers[0] as usize) < first + hidden,
                "dangling"
            );
            assert!(numbers[2] == 0.0 || numbers[2] == 1.0);
            genes.push((numbers[0] as usize, target, numbers[1], numbers[2] == 1.0));
        }
    }
    assert!(
        connections.flatten().all(|gene| *gene == 0.0),
        "genes that are not in use are 0"
    );
    assert!(nodes[3 * hidden..].iter().all(|gene| *gene == 0.0));
    let markings = (0..hidden).map(|node| nodes[3 * node] as u32).collect();
    (markings, genes)
}

fn check(operators: &GrowingNetwork, genome: &[f32]) {
    let (markings, connections) = decoded(operators, genome);
    assert_eq!(
        markings.iter().collect::<BTreeSet<_>>().len(),
        markings.len()
    );
    assert!(
        markings
            .iter()
            .all(|marking| (1..1 << 24).contains(marking))
    );
    let pairs: BTreeSet<_> = connections
        .iter()
        .map(|(source, target, ..)| (source, target))
        .collect();
    assert_eq!(
        pairs.len(),
        connections.len(),
        "two connections between the same nodes"
    );
    assert!(
        connections
            .iter()
            .all(|(_, _, weight, _)| weight.abs() <= 8.0)
    );
    let first = operators.sensors + 1;
    let hidden = first + operators.actuators;
    if !operators.recurrent {
        for (source, target, ..) in connections {
            assert!(
                !(first..hidden).contains(&source),
                "an actuator is an input"
            );
            assert!(target < hidden || source < target, "a cycle");
        }
    }
}

fn number() -> impl Strategy<Value = f32> {
    prop_oneof![8 => -9f32..40.0, 1 => -9f32..1e8, 1 => any::<f32>(), 1 => Just(f32::NAN)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn mutation_and_crossover_make_networks(recurrent in any::<bool>(), seeds in any::<(u64, u64)>(), mutations in 0u64..40) {
        let operators = operators(recurrent);
        let (mother, father) = (grown(&operators, seeds.0, mutations), grown(&operators, seeds.1, mutations / 2));
        check(&operators, &mother);
        let mut child = vec![0.0; mother.len()];
        operators.crossover(&mother, &father, &mut stream("cross", seeds.0), &mut child);
        check(&operators, &child);
        let structure = |genome: &[f32]| {
            let (markings, connections) = decoded(&operators, genome);
            (markings, connections.into_iter().map(|(source, target, ..)| (source, target)).collect::<Vec<_>>())
        };
        prop_assert_eq!(structure(&child), structure(&mother));
        let distance = |one: &[f32], other: &[f32]| operators.distance(one, other, Compatibility::PAPER);
        prop_assert_eq!(distance(&mother, &father), distance(&father, &mother));
        prop_assert_eq!(distance(&mother, &mother), 0.0);
    }

    #[test]
    fn any_numbers_are_a_genome(recurrent in any::<bool>(), numbers in prop::collection::vec(number(), 117), seed in any::<u64>()) {
        let operators = operators(recurrent);
        prop_assert_eq!(operators.genes(), numbers.len());
        let mut child = vec![0.0; numbers.len()];
        operators.crossover(&numbers, &grown(&operators, seed, 9), &mut stream("cross", seed), &mut child);
        decoded(&operators, &child);
        let mut mutant = vec![0.0; numbers.len()];
        operators.mutated(&child, &mut stream("mutate", seed), WEIGHTS, &mut mutant);
        decoded(&operators, &mutant);
    }
}

/// The only connection that is split gives the same node, whoever splits it and when.
#[test]
fn the_same_innovation_has_the_same_number() {
    let operators = GrowingNetwork {
        sensors: 1,
        actuators: 1,
        add_node: 1.0,
        add_connection: 0.0,
        toggle: 0.0,
        ..operators(false)
    };
    let markings: BTreeSet<u32> = (0..20)
        .map(|seed| decoded(&operators, &grown(&operators, seed, 1)).0[0])
        .collect();
    assert_eq!(markings.len(), 1);
    // The child of the smaller network with any other has the matching weights of both.
    let (small, large) = (grown(&operators, 1, 1), grown(&operators, 2, 5));
    assert!(
        operators.distance(
            &small,
            &large,
            Compatibility {
                disjoint: 1.0,
                weights: 0.0
            }
        ) > 0.0
    );
    let matching: BTreeSet<u32> = decoded(&operators, &large).0.into_iter().collect();
    assert!(matching.is_superset(&markings));
}

fn settings() -> NeatSettings {
    NeatSettings {
        compatibility: Compatibility::PAPER,
        threshold: 1.5,
        species: None,
        survival: 0.4,
        stagnation: 3,
        mutate_only: 0.25,
        interspecies: 0.05,
        weights: WEIGHTS,
    }
}

fn search(settings: NeatSettings) -> Neat {
    let operators = operators(true);
    let first = (0..40)
        .flat_map(|seed| grown(&operators, seed, 0))
        .collect();
    Neat::new((3, "neat"), first, operators, settings)
}

/// The sum of weights, which some lack.
fn fitness(operators: &GrowingNetwork, genomes: &[f32]) -> Vec<f64> {
    let sum_of = |genome: &[f32]| {
        decoded(operators, genome)
            .1
            .iter()
            .map(|gene| f64::from(gene.2))
            .sum::<f64>()
    };
    genomes
        .chunks_exact(operators.genes())
        .map(sum_of)
        .map(|value| if value < -9.0 { f64::NAN } else { value })
        .collect()
}

#[test]
fn species_cover_the_population_and_improve() {
    let operators = operators(true);
    let mut search = search(settings());
    let mut best = Vec::new();
    for _ in 0..30 {
        let genomes = search.ask().unwrap_or_default();
        assert_eq!(genomes.len(), 40 * operators.genes());
        let values = fitness(&operators, &genomes);
        best.push(values.iter().copied().fold(f64::NEG_INFINITY, f64::max));
        search.tell(&genomes, &values).unwrap_or_default();
        let species = search.state("species").unwrap_or_default();
        assert_eq!(species.len(), 40, "each genome has a species");
    }
    assert!(best[29] > best[0] + 5.0, "{best:?}");
    let species: BTreeSet<u64> = search
        .state("species")
        .unwrap_or_default()
        .iter()
        .map(|number| *number as u64)
        .collect();
    assert!(species.len() > 1);
}

#[test]
fn the_threshold_is_adapted_to_a_number_of_species() {
    let operators = operators(true);
    let mut search = search(NeatSettings {
        species: Some(8),
        threshold: 9.0,
        ..settings()
    });
    let mut counts = Vec::new();
    for _ in 0..40 {
        let genomes = search.ask().unwrap_or_default();
        search
            .tell(&genomes, &fitness(&operators, &genomes))
            .unwrap_or_default();
        counts.push(
            search
                .state("species")
                .unwrap_or_default()
                .iter()
                .map(|number| *number as u64)
                .collect::<BTreeSet<_>>()
                .len(),
        );
    }
    assert!(
        counts[30..].iter().all(|count| (3..=16).contains(count)),
        "{counts:?}"
    );
    assert!(search.state("threshold").unwrap_or_default()[0] < 9.0);
}

#[test]
fn genomes_that_are_like_no_species_join_the_nearest_of_many() {
    let operators = operators(true);
    let first = (0..1200)
        .flat_map(|seed| grown(&operators, seed, 0))
        .collect();
    let threshold = 1e-9;
    let settings = NeatSettings {
        threshold,
        ..settings()
    };
    let mut search = Neat::new((3, "neat"), first, operators.clone(), settings);
    let genomes = search.ask().unwrap_or_default();
    search.tell(&genomes, &[1.0; 1200]).unwrap_or_default();
    let species = search.state("species").unwrap_or_default();
    assert_eq!(species[999], 999.0, "each founds its own");
    let genome = |member: usize| &genomes[member * operators.genes()..][..operators.genes()];
    for member in [1000, 1199] {
        let distance = |other: &usize| {
            operators.distance(genome(member), genome(*other), Compatibility::PAPER)
        };
        let nearest =
            (0..1000).min_by(|first, second| distance(first).total_cmp(&distance(second)));
        assert_eq!(nearest, Some(species[member] as usize));
    }
}

#[test]
fn a_generation_that_failed_has_children() {
    let mut search = search(settings());
    let genomes = search.ask().unwrap_or_default();
    search.tell(&genomes, &[f64::NAN; 40]).unwrap_or_default();
    assert_eq!(search.ask().unwrap_or_default().len(), genomes.len());
}

#[test]
fn patterns_are_functions_of_space() {
    let operators = GrowingNetwork {
        sensors: 2,
        actuators: 1,
        nodes: 2,
        connections: 6,
        ..operators(false)
    };
    // The first hidden node takes x twice as it is, the second one the first and the bias; the actuator both, and y, which is disabled.
    let nodes = [2.0, 3.0, 7.0, 0.0, 1.0, 9.0, 1.0, 2.0];
    let connections = [
        [0.0, 2.0, 1.0],
        [4.0, -1.0, 1.0],
        [2.0, 0.25, 1.0],
        [4.0, 0.5, 1.0],
        [5.0, -0.75, 1.0],
        [1.0, 8.0, 0.0],
    ];
    let genome: Vec<f32> = nodes.into_iter().chain(connections.concat()).collect();
    let points = [0.0_f32, 0.0, 0.5, -1.0, -1.0, 3.0];
    let mut outputs = [0.0; 3];
    operators.pattern(&genome, &points, &mut outputs);
    for (point, output) in points.chunks_exact(2).zip(outputs) {
        let first = f64::from(-4.0 * point[0] * point[0]).exp();
        let second = (std::f64::consts::PI * (0.25 - first)).sin();
        let expected = (0.5 * first - 0.75 * second).tanh();
        assert!((f64::from(output) - expected).abs() < 1e-6, "{point:?}");
    }
    let mut elsewhere = [0.0];
    operators.pattern(&genome, &[0.5, 4.0], &mut elsewhere);
    assert_eq!(elsewhere[0], outputs[1], "y has no effect");
}

#[test]
fn functions_of_patterns_are_accurate_and_finite() {
    for a in [
        -1e30_f32, -70.3, -2.0, -1.0, -0.3, 0.0, 0.5, 1.0, 1.5, 33.75, 1e30,
    ] {
        let wide = f64::from(a);
        let sine = if wide.abs() < 1e9 {
            (std::f64::consts::PI * wide).sin()
        } else {
            0.0
        };
        let exact = [
            (-wide * wide).exp(),
            sine,
            wide.abs(),
            wide.tanh(),
            1.0 / (1.0 + (-wide).exp()),
            wide,
        ];
        for (function, expected) in PatternFunction::ALL.into_iter().zip(exact) {
            let found = f64::from(function.apply(a));
            assert!(
                (found - expected).abs() <= 1e-5 * expected.abs().max(1.0),
                "{function:?}({a}): {found}"
            );
        }
    }
}

proptest! {
    #[test]
    fn patterns_of_grown_networks_are_in_range(seed in 0_u64..200, mutations in 0_u64..30) {
        let operators = operators(false);
        let genome = grown(&operators, seed, mutations);
        let points: Vec<f32> = (0..30).map(|number| (number % 7) as f32 / 3.0 - 1.0).collect();
        let mut outputs = [2.0; 20];
        operators.pattern(&genome, &points, &mut outputs);
        prop_assert!(outputs.iter().all(|output| output.abs() <= 1.0));
    }
}
