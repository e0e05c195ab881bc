//! Covariance matrix adaptation. Its formulas are compared with NumPy's in tests/python/methods/test_cma.py.

use swarmwright_evolution::{Cma, Start, Stop, Stream};

const GENES: usize = 60;
const POPULATION: usize = 250;

fn search(separable: bool) -> Cma {
    Cma::new(Start {
        center: &[0.5; GENES],
        reach: &[2.0; GENES],
        lower: &[f64::NEG_INFINITY; GENES],
        upper: &[f64::INFINITY; GENES],
        step: 0.5,
        population: POPULATION,
        separable,
    })
}

fn sample(search: &mut Cma, generation: u64) -> Vec<f32> {
    let mut streams: Vec<Stream> = (0..POPULATION as u64)
        .map(|candidate| Stream::new(1, 2, generation, candidate))
        .collect();
    let mut genomes = vec![0.0; POPULATION * GENES];
    search.ask(&mut streams, &mut genomes);
    genomes
}

fn run(separable: bool, generations: u64) -> (Vec<f32>, Option<Stop>) {
    let mut search = search(separable);
    let (mut genomes, mut stop) = (Vec::new(), None);
    for generation in 0..generations {
        genomes = sample(&mut search, generation);
        let fitness: Vec<f64> = genomes
            .chunks_exact(GENES)
            .map(|genome| {
                -genome
                    .iter()
                    .map(|gene| f64::from(gene * gene))
                    .sum::<f64>()
            })
            .collect();
        stop = search.tell(&fitness);
        if stop.is_some() {
            break;
        }
    }
    (genomes, stop)
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    for separable in [false, true] {
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.unwrap().install(|| run(separable, 30).0)
        };
        let one = with(1);
        assert!(one.iter().all(|gene| gene.is_finite()));
        for threads in [2, 3, 7] {
            assert_eq!(with(threads), one);
        }
    }
}

#[test]
fn the_least_sum_of_squares_is_found() {
    for separable in [false, true] {
        let (genomes, stop) = run(separable, 1000);
        assert_eq!(stop, Some(Stop::Tolfun));
        assert!(genomes.iter().all(|gene| gene.abs() < 1e-5));
    }
}

#[test]
fn a_sample_is_repeated_with_the_same_streams() {
    let mut search = search(false);
    let first = sample(&mut search, 0);
    assert_eq!(sample(&mut search, 0), first);
    assert_ne!(sample(&mut search, 1), first);
    assert_eq!(search.tell(&vec![f64::NAN; POPULATION][..]), None);
    assert!(search.mean().iter().all(|gene| gene.is_finite()));
}
