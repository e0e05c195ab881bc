//! Polygons: what is refused, and what is inside.

#![allow(dead_code, clippy::unwrap_used, reason = "only their tests are wanted")]

#[path = "../src/math/polygon.rs"]
mod polygon;

use polygon::{along, area, contains, is_convex, tidy};
use proptest::prelude::*;

const SQUARE: [[f32; 2]; 4] = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
/// An L.
const BENT: [[f32; 2]; 6] = [
    [0.0, 0.0],
    [2.0, 0.0],
    [2.0, 1.0],
    [1.0, 1.0],
    [1.0, 2.0],
    [0.0, 2.0],
];

#[test]
fn corners_come_in_either_order_and_may_be_closed() {
    assert_eq!(tidy(&SQUARE).unwrap(), SQUARE);
    let mut closed = SQUARE.to_vec();
    closed.push(SQUARE[0]);
    assert_eq!(tidy(&closed).unwrap(), SQUARE);
    let clockwise: Vec<_> = BENT.iter().rev().copied().collect();
    assert_eq!(tidy(&clockwise).unwrap(), BENT);
    assert!(is_convex(&SQUARE) && !is_convex(&BENT));
    assert_eq!(area(&BENT), 3.0);
}

#[test]
fn what_is_no_polygon_is_refused() {
    let cases: [(&[[f32; 2]], &str); 6] = [
        (&SQUARE[..2], "2 corners found, expected 3 to 1000"),
        (&[[0.0, 0.0], [1.0, f32::NAN], [1.0, 0.0]], "finite"),
        (
            &[[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
            "[1, 0] occurs twice in a row",
        ),
        // A bow tie.
        (
            &[[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0]],
            "[0, 0] to [2, 2] and [2, 0] to [0, 2] cross",
        ),
        // Back along the same side.
        (&[[0.0, 0.0], [2.0, 0.0], [1.0, 0.0]], "cross or touch"),
        // A corner on another side.
        (
            &[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.0, 0.0], [0.0, 2.0]],
            "cross or touch",
        ),
    ];
    for (corners, expected) in cases {
        let message = tidy(corners).unwrap_err();
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    }
}

#[test]
fn points_along_the_sides_are_evenly_spaced() {
    let points = along(&SQUARE, 16);
    for (index, point) in points.iter().enumerate() {
        let [x, y] = points[(index + 1) % 16];
        let way = (point[0] - x).hypot(point[1] - y);
        assert!((way - 0.5).abs() < 1e-12, "{way}");
    }
}

proptest! {
    #[test]
    fn the_area_is_that_of_the_points_inside(turn in 0.0f64..6.3, x in -3.0f32..3.0, y in -3.0f32..3.0) {
        let corners: Vec<[f32; 2]> = BENT
            .iter()
            .map(|[a, b]| {
                let (sin, cos) = turn.sin_cos();
                let (a, b) = (f64::from(*a), f64::from(*b));
                [(a * cos - b * sin) as f32 + x, (a * sin + b * cos) as f32 + y]
            })
            .collect();
        let corners = tidy(&corners).unwrap();
        prop_assert!(!is_convex(&corners));
        let [low, high] = polygon::extent(&corners).map(|corner| corner.map(f64::from));
        let cells = 200;
        let inside = (0..cells * cells)
            .filter(|cell| {
                let at = |axis: usize, step: i32| {
                    low[axis] + (high[axis] - low[axis]) * (f64::from(step) + 0.5) / f64::from(cells)
                };
                contains(&corners, [at(0, cell % cells), at(1, cell / cells)])
            })
            .count();
        let share = inside as f64 / f64::from(cells * cells);
        let measured = share * (high[0] - low[0]) * (high[1] - low[1]);
        prop_assert!((measured - 3.0).abs() < 0.1, "{measured}");
        prop_assert!((area(&corners) - 3.0).abs() < 1e-5);
    }
}
