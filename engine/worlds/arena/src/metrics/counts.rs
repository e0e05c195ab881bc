//! Counts of robots in a tick, for a vector of lanes at a time.

use std::ops::Range;

use swarmwright_lanes::{Lanes, Mask, Number, number};

use crate::bodies::Bodies;
use crate::math::functions::absolute;
use crate::place::{Place, Shape};

/// Returns how many robots of a range are on a patch.
#[inline(always)]
pub(super) fn on<L: Lanes>(
    bodies: &Bodies<L>,
    layout: &Place,
    patch: &str,
    robots: Range<usize>,
) -> Number<L> {
    let mut count = number(0.0);
    if let Some(patch) = layout.patch(patch) {
        for index in robots {
            let on = patch.shape.holds(bodies.x[index], bodies.y[index]);
            count = count.add_where(number(1.0), on);
        }
    }
    count
}

/// Returns how many robots of a range are caught.
#[inline(always)]
pub(super) fn caught<L: Lanes>(bodies: &Bodies<L>, robots: Range<usize>) -> Number<L> {
    let mut count = number(0.0);
    for caught in bodies.caught.get(robots).into_iter().flatten() {
        count = count.add_where(number(1.0), *caught);
    }
    count
}

/// Returns how many flags are brought home in this tick: that with a name, or all.
#[inline(always)]
pub(super) fn brought<L: Lanes>(bodies: &Bodies<L>, name: Option<&str>) -> Number<L> {
    let mut count = number(0.0);
    for (flag, brought) in bodies.flags.iter().zip(&bodies.brought) {
        if name.is_none_or(|name| flag == name) {
            count = count.add_where(number(1.0), *brought);
        }
    }
    count
}

/// Returns how many flags robots carry: that with a name, or all.
#[inline(always)]
pub(super) fn carried<L: Lanes>(bodies: &Bodies<L>, name: Option<&str>) -> Number<L> {
    let mut count = number(0.0);
    for (flag, carried) in bodies.flags.iter().zip(bodies.carried.chunks(bodies.len())) {
        if name.is_none_or(|name| flag == name) {
            for carried in carried {
                count = count.add_where(number(1.0), *carried);
            }
        }
    }
    count
}

/// Returns the minimum and maximum number of robots for shares of all robots.
#[inline]
pub(super) fn bounds(at_least: Option<f64>, at_most: Option<f64>, robots: usize) -> [f32; 2] {
    // Tolerates rounding: 0.7 of 10 robots are 7.
    const ROUNDING: f64 = 1e-6;
    let all = robots as f64;
    let least = (at_least.unwrap_or(0.0) * all - ROUNDING).ceil();
    let most = (at_most.unwrap_or(1.0) * all + ROUNDING).floor();
    [least as f32, most as f32]
}

/// Sets `waits` to 0, permanently, in lanes whose count is within the bounds.
#[inline(always)]
pub(super) fn wait<L: Lanes>(count: Number<L>, [least, most]: [f32; 2], waits: &mut Number<L>) {
    let now = number(least).le(count).and(count.le(number(most)));
    *waits = number(0.0).select(*waits, now);
}

/// Counts robots that arrive at the nest from a source; `carries` is 1 for robots that have been
/// at a source since their last return.
#[inline(always)]
pub(super) fn returns<L: Lanes>(
    bodies: &Bodies<L>,
    layout: &Place,
    sources: &[String],
    nest: &str,
    carries: &mut [Number<L>],
) -> Number<L> {
    let mut count = number(0.0);
    for (index, carries) in carries.iter_mut().enumerate() {
        let (x, y) = (bodies.x[index], bodies.y[index]);
        let mut at_source = L::Mask::from_bits(0);
        for source in sources.iter().filter_map(|name| layout.patch(name)) {
            at_source = at_source.or(source.shape.holds(x, y));
        }
        let home = layout
            .patch(nest)
            .map_or(L::Mask::from_bits(0), |nest| nest.shape.holds(x, y));
        let home = home.and_not(at_source);
        count += carries.only_where(home);
        *carries = number(0.0).select(number(1.0).select(*carries, at_source), home);
    }
    count
}

/// Counts crossings of a patch's middle since the last tick, southward minus northward, within the patch's extent in x.
#[inline(always)]
pub(super) fn crossings<L: Lanes>(
    bodies: &Bodies<L>,
    layout: &Place,
    patch: &str,
    before: &[[Number<L>; 2]],
) -> Number<L> {
    let mut count = number(0.0);
    let Some(Shape::Box { low, high }) = layout.patch(patch).map(|patch| &patch.shape) else {
        return count;
    };
    let middle = number(low[1] + (high[1] - low[1]) * 0.5);
    for (index, [_, old]) in before.iter().enumerate() {
        let (x, y) = (bodies.x[index], bodies.y[index]);
        let inside = number(low[0]).lt(x).and(x.lt(number(high[0])));
        let south = middle.lt(*old).and(y.lt(middle)).and(inside);
        let north = old.lt(middle).and(middle.lt(y)).and(inside);
        count += one_where(south);
        count -= one_where(north);
    }
    count
}

/// Counts robots in the wrong half: at or below the middle if the patch is black, at or above it otherwise.
#[inline(always)]
pub(super) fn wrong_half<L: Lanes>(bodies: &Bodies<L>, middle: f32, color: Number<L>) -> Number<L> {
    let black = color.lt(number(0.5));
    let mut count = number(0.0);
    for y in &bodies.y {
        let below = y.le(number(middle)).and(black);
        let above = number(middle).le(*y).and_not(black);
        count = count.add_where(number(1.0), below.or(above));
    }
    count
}

/// Distance in a tick below which a robot counts as standing, metres.
const STANDS: f32 = 0.005;

/// Counts errors in stopping. Until a robot has been on the patch, all robots count once, and those that stand beside
/// the patch count twice; afterwards, robots that move both in x and in y count. `state` becomes 1 once a robot has
/// been on the patch.
///
/// A robot that moves along one axis only neither stands nor moves, as in the loop functions of AutoMoDe-Gianduja,
/// whose published scores serve for comparison.
#[inline(always)]
pub(super) fn stop<L: Lanes>(
    bodies: &Bodies<L>,
    layout: &Place,
    patch: &str,
    before: &[[Number<L>; 2]],
    state: &mut Number<L>,
) -> Number<L> {
    let Some(patch) = layout.patch(patch) else {
        return number(0.0);
    };
    let after = number(0.5).lt(*state);
    let (mut early, mut late) = (number(0.0), number(0.0));
    let mut on_patch = L::Mask::from_bits(0);
    for (index, [x, y]) in before.iter().enumerate() {
        let (nx, ny) = (bodies.x[index], bodies.y[index]);
        let on = patch.shape.holds(nx, ny);
        on_patch = on_patch.or(on);
        let (dx, dy) = (absolute(nx - *x), absolute(ny - *y));
        let least = number(STANDS);
        let stands = dx.lt(least).and(dy.lt(least)).and_not(on);
        early = early + number(1.0) + one_where(stands);
        late += one_where(least.lt(dx).and(least.lt(dy)));
    }
    *state = number(1.0).select(*state, on_patch);
    late.select(early, after)
}

/// Returns 1 where the condition holds, else 0.
#[inline(always)]
fn one_where<L: Lanes>(condition: L::Mask) -> Number<L> {
    if condition.any() {
        number::<L>(1.0).only_where(condition)
    } else {
        number(0.0)
    }
}
