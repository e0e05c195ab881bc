//! Normal numbers against the distribution, and their bits.

use swarmwright_evolution::{Stream, purpose_key};

#[test]
fn bits_are_the_same_everywhere() {
    let mut numbers = [0.0_f32; 5];
    Stream::new(7, purpose_key("golden"), 0, 0).normals(&mut numbers);
    assert_eq!(
        numbers.map(f32::to_bits),
        [
            0xBEFA_2566,
            0x3F7C_CBDA,
            0xBF6F_7A5F,
            0x3FDB_B90F,
            0x3FE5_84EE,
        ]
    );
}

#[test]
fn numbers_do_not_depend_on_how_many_are_drawn() {
    for count in [0, 1, 2, 7, 64, 65, 100_000] {
        let mut numbers = vec![0.0_f32; count];
        let mut stream = Stream::new(3, 5, 0, 0);
        stream.normals(&mut numbers);
        let mut one_by_one = Stream::new(3, 5, 0, 0);
        for pair in numbers.chunks(2) {
            let mut expected = [0.0; 2];
            one_by_one.normals(&mut expected);
            assert_eq!(pair, &expected[..pair.len()]);
        }
        assert_eq!(stream.word(), one_by_one.word());
    }
}

/// Moments, correlation within pairs, and the shares beyond 1, 2, 3, 4 and 5, each within five of its standard errors.
#[test]
fn ten_million_numbers_are_distributed_normally() {
    let count = 10_000_000_u32;
    let mut numbers = vec![0.0_f32; count as usize];
    Stream::new(11, purpose_key("normal"), 0, 0).normals(&mut numbers);
    let all = f64::from(count);
    let mean_of = |of: &dyn Fn(f64) -> f64| {
        numbers
            .iter()
            .map(|number| of(f64::from(*number)))
            .sum::<f64>()
            / all
    };
    // Expected value and variance of z, z^2, z^3, z^4.
    let moments = [(1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0)];
    for (power, expected, variance) in moments {
        let found = mean_of(&|z| z.powi(power));
        let error = (variance / all).sqrt();
        assert!(
            (found - expected).abs() < 5.0 * error,
            "moment {power}: {found}"
        );
    }
    let products: f64 = numbers
        .chunks_exact(2)
        .map(|pair| f64::from(pair[0]) * f64::from(pair[1]))
        .sum();
    assert!((products / (all / 2.0)).abs() < 5.0 / (all / 2.0).sqrt());
    // 2 (1 - Phi(k)), made with mpmath 1.3.
    let tails = [
        (1.0, 0.317_310_507_862_914_1),
        (2.0, 0.045_500_263_896_358_4),
        (3.0, 0.002_699_796_063_260_19),
        (4.0, 6.334_248_366_623_99e-5),
        (5.0, 5.733_031_437_583_88e-7),
    ];
    for (border, share) in tails {
        let found = mean_of(&|z| if z.abs() > border { 1.0 } else { 0.0 });
        let error = (share / all).sqrt();
        assert!(
            (found - share).abs() < 5.0 * error,
            "beyond {border}: {found}"
        );
    }
}
