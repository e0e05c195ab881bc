//! The sensor `neighbours`, which detects robots within a range, without loss, and through walls and objects.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::others::Others;
use crate::bodies::Bodies;
use crate::robots::Output;

/// Returns a quantity of the robots within a range, metres. For the count, only the first number is used.
#[inline(always)]
pub fn see<L: Lanes>(
    output: Output,
    range: f32,
    bodies: &Bodies<L>,
    index: usize,
    (others, indices): (&Others<L>, &[u32]),
) -> [Number<L>; 2] {
    let square = number::<L>(range * range);
    let (mut count, mut sum) = (number::<L>(0.0), [number::<L>(0.0); 2]);
    let (mut least, mut nearest) = (square, [number::<L>(0.0); 2]);
    for k in 0..others.len() {
        let other = &others[k];
        let close = other.square.lt(square);
        if !close.any() {
            continue;
        }
        count = count.add_where(number(1.0), close);
        if output == Output::NeighbourNearest {
            let nearer = other.square.lt(least);
            least = other.square.select(least, nearer);
            nearest = [
                other.x.select(nearest[0], nearer),
                other.y.select(nearest[1], nearer),
            ];
            continue;
        }
        let [x, y] = if output == Output::NeighbourHeading {
            let other = indices[k] as usize;
            [bodies.cos[other], bodies.sin[other]]
        } else {
            [other.x, other.y]
        };
        sum = [sum[0].add_where(x, close), sum[1].add_where(y, close)];
    }
    let ranges = number::<L>(1.0) / number(range);
    let mean = number::<L>(1.0) / count.at_least(number(1.0));
    let [x, y] = match output {
        Output::NeighbourCount => return [count, number(0.0)],
        Output::NeighbourNearest => [nearest[0] * ranges, nearest[1] * ranges],
        Output::NeighbourHeading => [sum[0] * mean, sum[1] * mean],
        _ => [sum[0] * mean * ranges, sum[1] * mean * ranges],
    };
    // Transform to the frame of the robot.
    let (cos, sin) = (bodies.cos[index], bodies.sin[index]);
    [x * cos + y * sin, y * cos - x * sin]
}
