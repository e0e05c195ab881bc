//! Flights of particle swarms, compared with the formula, in a box.

use swarmwright_evolution::{Flight, Stream, Swarm, purpose_key, spread};

const WIDE: [f64; 2] = [100.0; 2];
const LOW: [f64; 2] = [-100.0; 2];

fn swarm() -> Swarm<'static> {
    Swarm {
        inertia: 0.5,
        own: 2.0,
        social: 1.0,
        fastest: &[50.0; 2],
        lower: &LOW,
        upper: &WIDE,
    }
}

fn stream(candidate: u64) -> Stream {
    Stream::new(1, purpose_key("fly"), 0, candidate)
}

#[test]
fn a_flight_follows_the_formula() {
    let flight = Flight {
        from: &[1.0, -2.0],
        own: &[3.0, 0.0],
        social: &[1.0, 8.0],
    };
    let (mut velocity, mut to) = ([4.0, -1.0], [0.0; 2]);
    swarm().fly(flight, &mut stream(1), &mut velocity, &mut to);
    let mut words = stream(1);
    let mut shares = || {
        let word = words.word();
        [word >> 32, word & 0xffff_ffff].map(|half| half as f64 / 2.0_f64.powi(32))
    };
    let ([own, social], [other_own, other_social]) = (shares(), shares());
    let first = 0.5 * 4.0 + 2.0 * own * 2.0 + social * 0.0;
    let second = -0.5 + 2.0 * other_own * 2.0 + other_social * 10.0;
    assert_eq!(velocity, [first, second]);
    assert_eq!(to, [1.0 + first, -2.0 + second]);
}

#[test]
fn velocities_are_limited_and_flights_end_in_the_box() {
    let flight = Flight {
        from: &[0.0, 0.5],
        own: &[0.0, 0.5],
        social: &[1.0, 0.5],
    };
    let narrow = Swarm {
        fastest: &[0.25, 3.0],
        lower: &[0.0, 0.0],
        upper: &[1.0, 1.0],
        ..swarm()
    };
    for candidate in 0..500 {
        let (mut velocity, mut to) = ([-9.0, 8.0], [0.0; 2]);
        narrow.fly(flight, &mut stream(candidate), &mut velocity, &mut to);
        assert_eq!(velocity[0].to_bits(), (-0.25f64).to_bits());
        assert!(
            (0.0..=1.0).contains(&to[0]) && (0.0..=1.0).contains(&to[1]),
            "{to:?}"
        );
    }
}

#[test]
fn a_perturbed_particle_is_near_the_best_place() {
    let mut same = 0;
    for candidate in 0..1000 {
        let mut to = [0.0; 2];
        swarm().perturb(&[5.0, -7.0], &mut stream(candidate), &mut to);
        same += usize::from(to == [5.0, -7.0]);
        assert!(to.iter().all(|gene| gene.abs() <= 100.0));
    }
    assert_eq!(same, 0, "one gene at least has changed");
}

#[test]
fn the_spread_is_that_of_mean_distances() {
    // On a line at 0, 1 and 4, of width 2: mean distances to the others 1.25, 1, 1.75.
    let places = [0.0, 1.0, 4.0];
    for (best, mean) in [(1.0, 4.0 / 6.0), (4.0, 7.0 / 6.0)] {
        let found = spread(&places, &[best], &[2.0]);
        assert!((found - (mean - 1.0) / 0.75).abs() < 1e-12, "{found}");
    }
    assert!(
        spread(&[1.0, 1.0], &[1.0], &[2.0]).is_finite(),
        "all in one place"
    );
}

#[test]
fn distances_are_added_in_the_order_of_the_places() {
    for (count, genes) in [(2, 1), (3, 5), (33, 7), (64, 49)] {
        let mut numbers = stream(count as u64);
        let places: Vec<f32> = (0..count * genes)
            .map(|_| numbers.uniform(3.0) as f32)
            .collect();
        let width: Vec<f64> = (0..genes).map(|gene| 1.0 + gene as f64).collect();
        let row = |place: usize| &places[place * genes..(place + 1) * genes];
        let mean = |from: &[f32], among: usize| {
            let mut sum = 0.0;
            for place in 0..count {
                let mut square = 0.0;
                for gene in 0..genes {
                    let scaled = |value: f32| f64::from(value) / width[gene];
                    let difference = scaled(from[gene]) - scaled(row(place)[gene]);
                    square += difference * difference;
                }
                sum += f64::sqrt(square);
            }
            sum / among as f64
        };
        let means: Vec<f64> = (0..count)
            .map(|place| mean(row(place), count - 1))
            .collect();
        let least = means.iter().copied().fold(f64::INFINITY, f64::min);
        let most = means.iter().copied().fold(0.0, f64::max);
        let best = row(count / 2);
        let expected = (mean(best, count) - least) / (most - least + 1e-32);
        let found = spread(&places, best, &width);
        assert_eq!(found.to_bits(), expected.to_bits(), "{count} places");
    }
}
