//! Polygons as lists of corners, the last one connected to the first.

/// A point, metres.
type Point = [f32; 2];

/// Returns twice the signed area, exact enough for its sign; positive if the corners are counter-clockwise.
fn doubled_area(corners: &[Point]) -> f64 {
    sides(corners).fold(0.0, |sum, [a, b]| {
        sum + f64::from(a[0]) * f64::from(b[1]) - f64::from(a[1]) * f64::from(b[0])
    })
}

/// Returns the area, m^2.
pub fn area(corners: &[Point]) -> f64 {
    doubled_area(corners).abs() / 2.0
}

/// Returns twice the signed area of the triangle a, b, c; positive if c lies to the left of the line from a to b.
fn left(a: Point, b: Point, c: Point) -> f64 {
    let [a, b, c] = [a, b, c].map(|point| point.map(f64::from));
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Returns whether two sides have a point in common.
fn meet([a, b]: [Point; 2], [c, d]: [Point; 2]) -> bool {
    let apart = |p: f64, q: f64| p * q > 0.0;
    let beside = |axis: usize| {
        a[axis].max(b[axis]) < c[axis].min(d[axis]) || c[axis].max(d[axis]) < a[axis].min(b[axis])
    };
    !beside(0)
        && !beside(1)
        && !apart(left(a, b, c), left(a, b, d))
        && !apart(left(c, d, a), left(c, d, b))
}

/// Returns the corners in counter-clockwise order, without a repeated first corner at the end.
///
/// # Errors
/// Returns the problem with the polygon: too few or too many corners, a repeated corner, or crossing sides.
pub fn tidy(corners: &[Point]) -> Result<Vec<Point>, String> {
    let mut corners = corners.to_vec();
    if corners.len() > 1 && corners.first() == corners.last() {
        corners.pop();
    }
    let count = corners.len();
    if !(3..=1000).contains(&count) {
        return Err(format!("{count} corners found, expected 3 to 1000"));
    }
    if corners.iter().flatten().any(|number| !number.is_finite()) {
        return Err("corners must be finite numbers".to_owned());
    }
    let side = |index: usize| [corners[index], corners[(index + 1) % count]];
    let name = |[a, b]: [Point; 2]| format!("[{}, {}] to [{}, {}]", a[0], a[1], b[0], b[1]);
    if let Some(index) = (0..count).find(|index| side(*index)[0] == side(*index)[1]) {
        return Err(format!(
            "the corner [{}, {}] occurs twice in a row",
            corners[index][0], corners[index][1]
        ));
    }
    for first in 0..count {
        for second in first + 1..count {
            let (edge, other) = (side(first), side(second));
            let neighbours = second == first + 1 || (first == 0 && second == count - 1);
            let crossed = if neighbours {
                // Neighbouring sides share a corner; they may not overlap otherwise.
                let [tip, joint, end] = if second == first + 1 {
                    [edge[0], edge[1], other[1]]
                } else {
                    [edge[1], edge[0], other[0]]
                };
                let back = (0..2).fold(0.0, |sum, axis| {
                    let way = |point: Point| f64::from(point[axis]) - f64::from(joint[axis]);
                    sum + way(tip) * way(end)
                });
                left(tip, joint, end) == 0.0 && back > 0.0
            } else {
                meet(edge, other)
            };
            if crossed {
                return Err(format!(
                    "the sides {} and {} cross or touch; expected the corners in order along the walls",
                    name(edge),
                    name(other)
                ));
            }
        }
    }
    if doubled_area(&corners) < 0.0 {
        corners.reverse();
    }
    Ok(corners)
}

/// Returns whether no corner points inwards; the corners must be counter-clockwise.
pub fn is_convex(corners: &[Point]) -> bool {
    let count = corners.len();
    (0..count).all(|index| {
        let at = |ahead: usize| corners[(index + ahead) % count];
        left(at(0), at(1), at(2)) >= 0.0
    })
}

/// Returns whether a point lies inside, by the parity of the sides that a ray from it crosses.
pub fn contains(corners: &[Point], [x, y]: [f64; 2]) -> bool {
    sides(corners).fold(false, |inside, side| {
        let [a, b] = side.map(|corner| corner.map(f64::from));
        let crosses =
            (a[1] > y) != (b[1] > y) && x < a[0] + (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]);
        inside != crosses
    })
}

/// Returns whether a side of one polygon passes through a side of the other; touching is not enough.
pub fn cross(outline: &[Point], other: &[Point]) -> bool {
    let through = |[a, b]: [Point; 2], [c, d]: [Point; 2]| {
        left(a, b, c) * left(a, b, d) < 0.0 && left(c, d, a) * left(c, d, b) < 0.0
    };
    sides(outline).any(|side| sides(other).any(|another| through(side, another)))
}

/// Returns the distance of a point from the nearest side.
pub fn distance(corners: &[Point], point: Point) -> f64 {
    let from = sides(corners).map(|[a, b]| {
        let way =
            |from: Point, to: Point| [0, 1].map(|axis| f64::from(to[axis]) - f64::from(from[axis]));
        let ([x, y], [u, v]) = (way(a, point), way(a, b));
        let along = ((x * u + y * v) / (u * u + v * v)).clamp(0.0, 1.0);
        (x - along * u).hypot(y - along * v)
    });
    from.fold(f64::INFINITY, f64::min)
}

/// Returns the sides, from each corner to the next one.
pub fn sides(corners: &[Point]) -> impl Iterator<Item = [Point; 2]> + '_ {
    let next = corners.iter().cycle().skip(1);
    corners.iter().zip(next).map(|(a, b)| [*a, *b])
}

/// Returns the lower left and upper right corners of the bounding box.
pub fn extent(corners: &[Point]) -> [Point; 2] {
    let start = [[f32::INFINITY; 2], [f32::NEG_INFINITY; 2]];
    corners.iter().fold(start, |[low, high], corner| {
        [
            [low[0].min(corner[0]), low[1].min(corner[1])],
            [high[0].max(corner[0]), high[1].max(corner[1])],
        ]
    })
}

/// Returns evenly spaced points along the sides, starting at the first corner.
pub fn along(corners: &[Point], count: usize) -> Vec<[f64; 2]> {
    let sides: Vec<[[f64; 2]; 2]> = sides(corners)
        .map(|side| side.map(|corner| corner.map(f64::from)))
        .collect();
    let length = |[a, b]: &[[f64; 2]; 2]| {
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        (dx * dx + dy * dy).sqrt()
    };
    let total: f64 = sides.iter().map(length).sum();
    let mut points = Vec::with_capacity(count);
    for index in 0..count {
        let mut way = total * index as f64 / count as f64;
        let mut at = sides.len() - 1;
        for (number, side) in sides.iter().enumerate() {
            if way <= length(side) {
                at = number;
                break;
            }
            way -= length(side);
        }
        let [a, b] = sides[at];
        let part = way / length(&sides[at]);
        points.push([a[0] + (b[0] - a[0]) * part, a[1] + (b[1] - a[1]) * part]);
    }
    points
}
