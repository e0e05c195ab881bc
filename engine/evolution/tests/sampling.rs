//! Samples of evolution strategies.

use swarmwright_evolution::{Scale, add_weighted, add_weighted_products, samples};

const SCALE: Scale<'static> = Scale {
    middle: &[1.0, 0.0],
    reach: &[2.0, 10.0],
    lower: &[-5.0, -3.0],
    upper: &[5.0, 3.0],
};

#[test]
fn two_samples_lie_on_opposite_sides_of_the_center_within_the_limits() {
    let mut genomes = [0.0; 8];
    samples(
        &[1.0, 0.5, -3.0, 0.0],
        &[0.5, 0.0],
        &[0.25, 0.25],
        SCALE,
        true,
        &mut genomes,
    );
    assert_eq!(genomes, [2.5, 1.25, 1.5, -1.25, 0.5, 0.0, 3.5, 0.0]);
    samples(
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
        &[1e300, 1.0, -1e300, f64::NAN, f64::NAN, 4.0],
        &[1.0, 0.0, 0.0],
        &mut sum,
    );
    assert_eq!(sum, [1e300, 1.0]);
    let mut sum = [0.0; 1];
    add_weighted(&[1e16, 1.0, -1e16], &[1.0; 3], &mut sum);
    assert_eq!(sum, [0.0], "rounded after each row");
}

#[test]
fn each_gene_has_a_deviation_of_its_own() {
    let mut genomes = [0.0; 4];
    samples(
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
        &[1.0, 2.0, f64::NAN, 1.0, -1.0, 3.0],
        &[0.5, 0.0, 2.0],
        &mut sum,
    );
    assert_eq!(sum, [2.5, -5.0, -5.0, 20.0]);
}
