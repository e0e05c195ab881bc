//! Samples of evolution strategies.

use proptest::prelude::*;
use swarmwright_evolution::{
    GaussianSample, Scale, Stream, add_weighted, add_weighted_products, add_weighted_squares,
    normal_rows, purpose_key, samples,
};

const SCALE: Scale<'static> = Scale {
    middle: &[1.0, 0.0],
    reach: &[2.0, 10.0],
    lower: &[-5.0, -3.0],
    upper: &[5.0, 3.0],
};

#[test]
fn two_samples_lie_on_opposite_sides_of_the_center_within_the_limits() {
    let mut genomes = [0.0; 8];
    samples::<f32>(
        &[1.0, 0.5, -3.0, 0.0],
        &[0.5, 0.0],
        &[0.25, 0.25],
        SCALE,
        true,
        &mut genomes,
    );
    assert_eq!(genomes, [2.5, 1.25, 1.5, -1.25, 0.5, 0.0, 3.5, 0.0]);
    samples::<f32>(
        &[100.0, 1.0, 0.0, 2.0],
        &[0.0, 0.0],
        &[1.0, 1.0],
        SCALE,
        true,
        &mut genomes,
    );
    assert_eq!(genomes, [5.0, 3.0, -5.0, -3.0, 1.0, 3.0, 1.0, -3.0]);
}

#[test]
fn rows_are_added_in_order_and_those_of_weight_0_left_out() {
    let mut sum = [0.0; 2];
    add_weighted(
        &[1e38, 1.0, -1e38, f32::NAN, f32::NAN, 4.0],
        &[1.0, 0.0, 0.0],
        &mut sum,
    );
    assert_eq!(sum, [f64::from(1e38_f32), 1.0]);
    let large = 2.0_f32.powi(54);
    for weights in [[1.0; 6], [1.0, 0.0, 1.0, 1.0, 1.0, 1.0]] {
        let mut sum = [0.0; 1];
        add_weighted(&[large, 0.0, 1.0, -large, 4.0, 0.5], &weights, &mut sum);
        assert_eq!(sum, [4.5], "rounded after each row");
        add_weighted_squares(&[2.0, 0.0, 1.0, -3.0, 4.0, 0.5], &weights, &mut sum);
        assert_eq!(sum, [4.5 + 30.25]);
    }
}

#[test]
fn each_gene_has_a_deviation_of_its_own() {
    let mut genomes = [0.0; 4];
    samples::<f32>(
        &[1.0, 0.5, -3.0, 0.0],
        &[0.5, 0.0],
        &[0.25, 0.5],
        SCALE,
        false,
        &mut genomes,
    );
    assert_eq!(genomes, [2.5, 2.5, 0.5, 0.0]);
}

#[test]
fn products_of_rows_make_a_symmetric_matrix() {
    let mut sum = [0.0; 4];
    add_weighted_products(
        &[1.0, 2.0, f32::NAN, 1.0, -1.0, 3.0],
        &[0.5, 0.0, 2.0],
        &mut sum,
    );
    assert_eq!(sum, [2.5, -5.0, -5.0, 20.0]);
}

proptest! {
    #[test]
    fn rows_are_those_of_each_candidates_stream(
        seed: u64, generation: u64, first in 0..u64::MAX / 2, length in 1_usize..300, rows in 0_usize..90,
    ) {
        let purpose = purpose_key("test");
        let mut found = vec![0.0; rows * length];
        normal_rows(seed, purpose, generation, first, length, &mut found);
        for (candidate, row) in (first..).zip(found.chunks(length)) {
            let mut expected = vec![0.0; length];
            Stream::new(seed, purpose, generation, candidate).normals(&mut expected);
            prop_assert_eq!(row, expected);
        }
    }

    #[test]
    fn any_part_of_a_sample_is_what_the_whole_has_there(
        seed: u64, generation: u64, mirrored: bool, genes in 1_usize..70, pairs in 1_usize..1500, places: (usize, usize),
    ) {
        let purpose = purpose_key("test");
        let number = |salt: u64, gene: usize| Stream::new(seed, salt, 0, gene as u64).uniform(3.0);
        let row = |salt: u64| (0..genes).map(|gene| number(salt, gene)).collect::<Vec<f64>>();
        let (center, deviation, middle, reach) = (row(1), row(2), row(3), row(4));
        let (lower, upper) = (vec![-4.0; genes], vec![4.0; genes]);
        let scale = Scale { middle: &middle, reach: &reach, lower: &lower, upper: &upper };
        let gaussian = GaussianSample {
            seed, purpose: "test", generation, mirrored, center: &center, deviation: &deviation, scale,
        };
        let count = 2 * pairs;
        let mut directions = vec![0.0; if mirrored { pairs } else { count } * genes];
        for (candidate, row) in (0..).zip(directions.chunks_mut(genes)) {
            Stream::new(seed, purpose, generation, candidate).normals(row);
        }
        let mut whole = vec![0.0; count * genes];
        samples(&directions, &center, &deviation, scale, mirrored, &mut whole);
        let first = places.0 % count;
        let end = first + places.1 % (count - first + 1);
        let mut part = vec![0.0; (end - first) * genes];
        gaussian.genomes(first as u64, &mut part);
        prop_assert_eq!(&part[..], &whole[first * genes..end * genes]);
        part.fill(0.0);
        gaussian.genomes_parallel(first as u64, &mut part);
        prop_assert_eq!(&part[..], &whole[first * genes..end * genes]);
    }
}
