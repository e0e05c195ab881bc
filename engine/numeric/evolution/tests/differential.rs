//! Trial vectors of differential evolution, compared with what the textbook says of them.

use swarmwright_evolution::{Base, Crossover, Differential, Stream, purpose_key};

const GENES: usize = 8;
const LOWER: [f64; GENES] = [-10.0; GENES];
const UPPER: [f64; GENES] = [10.0; GENES];

fn settings() -> Differential {
    Differential {
        base: Base::Best,
        crossover: Crossover::Binomial,
        factor: 0.5,
        rate: 1.0,
        mutate: 0.0,
    }
}

/// Members whose first gene is their number, so that a difference names the two.
fn members(count: u16) -> Vec<f32> {
    (0..count)
        .flat_map(|member| [f32::from(member) / 16.0; GENES])
        .collect()
}

fn trial(settings: Differential, members: &[f32], target: usize, candidate: u64) -> Vec<f64> {
    trial_in(settings, (&LOWER, &UPPER), members, target, candidate)
}

fn trial_in(
    settings: Differential,
    bounds: (&[f64], &[f64]),
    members: &[f32],
    target: usize,
    candidate: u64,
) -> Vec<f64> {
    let mut stream = Stream::new(1, purpose_key("trial"), 0, candidate);
    let mut trial_vector = vec![0.0; GENES];
    settings.trial(members, 3, target, bounds, &mut stream, &mut trial_vector);
    trial_vector
}

#[test]
fn a_difference_of_two_other_members_is_added_to_the_best() {
    let members = members(6);
    let mut seen = std::collections::BTreeSet::new();
    for candidate in 0..2000 {
        let made = trial(settings(), &members, 1, candidate);
        assert!(made.iter().all(|gene| gene.to_bits() == made[0].to_bits()));
        #[expect(clippy::cast_possible_truncation, reason = "a whole number")]
        seen.insert(((made[0] - 3.0 / 16.0) * 32.0) as i64);
    }
    // Of 0, 2, 3, 4, 5 without 1: no difference is 0.
    assert_eq!(seen, [-5, -4, -3, -2, -1, 1, 2, 3, 4, 5].into());
}

#[test]
fn the_base_is_the_one_that_was_chosen() {
    let members = members(6);
    let none = Differential {
        factor: 1e-12,
        base: Base::Random,
        ..settings()
    };
    let mut seen = std::collections::BTreeSet::new();
    for candidate in 0..500 {
        let made = trial(none, &members, 1, candidate)[0] * 16.0;
        #[expect(clippy::cast_possible_truncation, reason = "a whole number")]
        seen.insert(made.round() as i64);
    }
    assert_eq!(seen, [0, 2, 3, 4, 5].into(), "all but the target");
    let toward = Differential {
        base: Base::TargetToBest,
        factor: 1e-12,
        ..settings()
    };
    assert!((trial(toward, &members, 1, 1)[0] * 16.0 - 1.0).abs() < 1e-6);
}

#[test]
fn at_least_one_gene_is_the_mutants() {
    let members = members(6);
    for crossover in [Crossover::Binomial, Crossover::Exponential] {
        for rate in [0.0, 0.5] {
            let mut most = 0;
            for candidate in 0..200 {
                let made = trial(
                    Differential {
                        crossover,
                        rate,
                        ..settings()
                    },
                    &members,
                    0,
                    candidate,
                );
                let changed: Vec<bool> = made.iter().map(|gene| *gene != 0.0).collect();
                let count = changed.iter().filter(|one| **one).count();
                assert!(count >= 1);
                most = most.max(count);
                if crossover == Crossover::Exponential {
                    let borders = (0..GENES)
                        .filter(|gene| changed[*gene] && !changed[(gene + 1) % GENES])
                        .count();
                    assert!(borders <= 1, "one run, also across the end");
                }
            }
            assert_eq!(most > 1, rate > 0.0);
        }
    }
}

/// Genes of many trial vectors as shares of the way from the target, at 0, to the mutant.
fn shares(crossover: Crossover, rate: f64) -> Vec<Vec<f64>> {
    let settings = Differential {
        crossover,
        rate,
        factor: 1e-12,
        ..settings()
    };
    let members = members(6);
    (0..2000)
        .map(|candidate| {
            let trial_vector = trial(settings, &members, 0, candidate);
            trial_vector
                .iter()
                .map(|gene| gene / (3.0 / 16.0))
                .collect()
        })
        .collect()
}

#[test]
fn the_rate_means_what_its_crossover_says() {
    let mean = |shares: &[Vec<f64>]| {
        let all = shares.concat();
        all.iter().sum::<f64>() / all.len() as f64
    };
    let genes = GENES as f64;
    // One gene in any case, each of the others with the probability of the rate.
    let binomial = mean(&shares(Crossover::Binomial, 0.5));
    assert!(
        (binomial - (1.0 + 0.5 * (genes - 1.0)) / genes).abs() < 0.01,
        "{binomial}"
    );
    // A run of one gene that goes on with the probability of the rate: 1 + r + r^2 + ... genes.
    let exponential = mean(&shares(Crossover::Exponential, 0.5));
    let run = (1.0 - 0.5_f64.powi(8)) / 0.5;
    assert!((exponential - run / genes).abs() < 0.01, "{exponential}");
    for crossover in [Crossover::Hypercube, Crossover::Line] {
        let shares = shares(crossover, 0.5);
        let uniform = mean(&shares);
        assert!((uniform - 0.25).abs() < 0.01, "{crossover:?}: {uniform}");
        let all = shares.concat();
        let most = all.iter().copied().fold(0.0, f64::max);
        assert!((0.49..0.500_001).contains(&most), "{crossover:?}: {most}");
        let same = shares.iter().all(|one| {
            let first = one[0];
            one.iter().all(|share| (share - first).abs() < 1e-6)
        });
        assert_eq!(same, crossover == Crossover::Line);
    }
}

#[test]
fn what_leaves_the_box_comes_back_between_the_bound_and_where_it_came_from() {
    let members = members(6);
    let bounds = (&[0.15; GENES][..], &[0.2; GENES][..]);
    let wide = Differential {
        factor: 2.0,
        ..settings()
    };
    for candidate in 0..500 {
        for gene in trial_in(wide, bounds, &members, 1, candidate) {
            assert!((0.15..=0.2).contains(&gene), "{gene}");
        }
    }
}

#[test]
fn a_mutation_changes_one_gene_at_least_a_little_and_stays_inside() {
    let members = [0.0; 6 * GENES];
    let (mut changes, mut sum) = (0, 0.0);
    for candidate in 0..2000 {
        let made = trial(
            Differential {
                mutate: 1.0,
                ..settings()
            },
            &members,
            1,
            candidate,
        );
        let changed: Vec<f64> = made.into_iter().filter(|gene| *gene != 0.0).collect();
        assert!(!changed.is_empty());
        changes += changed.len();
        sum += changed.iter().sum::<f64>();
        assert!(changed.iter().all(|gene| gene.abs() <= 10.0));
    }
    // One of 8 genes, and one more where there was none: 1 + (7/8)^8 on average.
    assert!((2500..2900).contains(&changes), "{changes}");
    assert!(sum.abs() < 250.0, "to both sides alike: {sum}");
}
