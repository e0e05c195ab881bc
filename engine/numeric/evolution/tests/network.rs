//! The genetic operators against their description.

use proptest::prelude::*;
use swarmwright_evolution::{Mutation, NodeNetwork, Stream, distance, distances};

fn stream(seed: u64) -> Stream {
    Stream::new(seed, 7, 0, 0)
}

fn genome(network: &NodeNetwork, seed: u64) -> Vec<f32> {
    let mut genome = vec![0.0; network.genes()];
    network.initial(&mut stream(seed), &mut genome);
    genome
}

proptest! {
    #[test]
    fn genes_start_within_their_ranges(sizes in prop::collection::vec(1_usize..6, 1..6), seed: u64) {
        let network = NodeNetwork::new(&sizes, 0.5, 3.0, Mutation::Uniform);
        let genome = genome(&network, seed);
        let mut rest = genome.as_slice();
        for size in sizes {
            let (node, others) = rest.split_at(1 + size);
            rest = others;
            prop_assert!(node[0].abs() <= 3.0);
            prop_assert!(node[1..].iter().all(|weight| weight.abs() <= 0.5));
        }
        prop_assert!(rest.is_empty());
    }

    #[test]
    fn a_crossover_takes_a_run_of_nodes(sizes in prop::collection::vec(1_usize..6, 2..8), seed: u64) {
        let network = NodeNetwork::new(&sizes, 2.0, 2.0, Mutation::Uniform);
        let (mother, father) = (vec![0.0; network.genes()], vec![1.0; network.genes()]);
        let mut child = vec![9.0; network.genes()];
        network.crossover(&mother, &father, &mut stream(seed), &mut child);
        let mut rest = child.as_slice();
        let mut nodes = String::new();
        for size in &sizes {
            let (node, others) = rest.split_at(1 + size);
            rest = others;
            prop_assert!(node.iter().all(|gene| gene.to_bits() == node[0].to_bits()));
            nodes.push(if node[0] > 0.5 { '1' } else { '0' });
        }
        let run = nodes.trim_matches('0');
        prop_assert!(!run.is_empty() && !run.contains('0') && run.len() < sizes.len(), "{}", nodes);
    }

    #[test]
    fn a_mutation_does_not_depend_on_how_its_words_are_drawn(seed: u64, probability in 0.01_f64..1.0) {
        // With every probability below 1 all words are drawn, with 1 half of them are passed over: where both move a
        // gene, they move it alike.
        let network = NodeNetwork::new(&[3, 3, 5], 2.0, 2.0, Mutation::Uniform);
        let parent = genome(&network, seed);
        let (mut some, mut all) = (parent.clone(), parent.clone());
        let (mut one, mut other) = (stream(seed), stream(seed));
        network.mutate(&parent, &mut one, 0.3, probability, &mut some);
        network.mutate(&parent, &mut other, 0.3, 1.0, &mut all);
        for ((some, all), parent) in some.iter().zip(&all).zip(&parent) {
            prop_assert!(some.to_bits() == all.to_bits() || some.to_bits() == parent.to_bits());
        }
        prop_assert_eq!(one.word(), other.word());
    }

    #[test]
    fn distances_are_each_the_distance(count in 0_usize..13, seed: u64) {
        let network = NodeNetwork::new(&[3, 3, 5], 2.0, 2.0, Mutation::Uniform);
        let one = genome(&network, seed);
        let others: Vec<_> = (1..=count as u64).map(|next| genome(&network, seed.wrapping_add(next))).collect();
        let rows: Vec<&[f32]> = others.iter().map(Vec::as_slice).collect();
        let mut found = vec![0.0; count];
        distances(&one, &rows, &mut found);
        for (found, other) in found.iter().zip(&others) {
            prop_assert_eq!(found.to_bits(), distance(&one, other).to_bits());
            prop_assert_eq!(found.to_bits(), distance(other, &one).to_bits());
        }
    }
}

#[test]
fn no_probability_and_no_severity_change_nothing() {
    let network = NodeNetwork::new(&[3, 2], 2.0, 2.0, Mutation::Uniform);
    let parent = genome(&network, 1);
    for (severity, probability) in [(0.3, 0.0), (0.0, 1.0)] {
        let mut child = vec![9.0; network.genes()];
        network.mutate(&parent, &mut stream(1), severity, probability, &mut child);
        assert_eq!(child, parent);
    }
}

#[test]
fn a_proportional_mutation_goes_by_the_size_of_the_gene() {
    let network = NodeNetwork::new(&[999], 2.0, 2.0, Mutation::Proportional);
    for (value, border) in [(-50.0_f32, 10.0_f32), (0.01, 0.1)] {
        let mut child = vec![0.0; 1000];
        network.mutate(&vec![value; 1000], &mut stream(3), 0.0, 1.0, &mut child);
        let most = child
            .iter()
            .map(|gene| (gene - value).abs())
            .fold(0.0, f32::max);
        assert!(most <= border * 1.0001 && most > border * 0.99, "{most}");
    }
}
