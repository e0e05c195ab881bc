//! Metrics of a swarm at one moment of an episode. They use binary64 throughout, so that lanes and single steps agree.

use swarmwright_lanes::MOST_LANES;

use super::formation::Outline;
use super::kind::Metric;
use super::shapes;
use super::state::{State, center, length, square, sum};
use crate::math::polygon;
use crate::place::Place;

/// Side of the squares that sample the free floor, metres.
const SQUARE: f64 = 0.05;
/// Maximum number of squares; larger arenas have larger squares.
const MOST_SQUARES: f64 = 100_000.0;

/// Values that a metric computes once and reuses.
#[derive(Debug, Default)]
pub(super) struct MetricCache {
    /// Middles of the squares of the free floor.
    floor: Vec<[f64; 2]>,
    outline: Option<Outline>,
}

/// Returns the current value of a metric.
#[inline]
pub(super) fn value(
    metric: &Metric,
    robots: &[State],
    layout: &Place,
    cache: &mut MetricCache,
) -> f64 {
    let count = robots.len() as f64;
    match metric {
        Metric::Order { .. } => {
            let mean = length(sum(robots.iter().map(|robot| robot.heading))) / count;
            // Rounding may make binary32 headings slightly longer than 1.
            mean.min(1.0)
        }
        Metric::Speed { .. } => {
            let speeds = robots.iter().map(|robot| length(robot.velocity));
            speeds.sum::<f64>() / count
        }
        Metric::GroupSpeed { link: None, .. } => {
            length(sum(robots.iter().map(|robot| robot.velocity))) / count
        }
        Metric::GroupSpeed {
            link: Some(link), ..
        } => {
            let members = groups(robots, *link).members(robots);
            length(sum(members.map(|robot| robot.velocity))) / count
        }
        Metric::DistanceToCenter { .. } => {
            let center = center(robots);
            let distances = robots.iter().map(|robot| square(robot.at, center).sqrt());
            distances.sum::<f64>() / count
        }
        Metric::NearestDistance { .. } => nearest(robots),
        Metric::LargestGroup { link, share, .. } => {
            let members = groups(robots, *link).size as f64;
            if *share { members / count } else { members }
        }
        Metric::Groups { link, .. } => groups(robots, *link).count as f64,
        Metric::CoveredShare { radius, .. } => covered(robots, layout, *radius, &mut cache.floor),
        Metric::ShapeDeviation { shape, .. } => cache
            .outline
            .get_or_insert_with(|| shape.outline(robots.len()))
            .deviation(robots, shape),
        Metric::ChainReach { from, to, link, .. } => {
            let middle = |name: &str| layout.patch(name).map(|patch| patch.shape.middle());
            match (middle(from), middle(to)) {
                (Some(from), Some(to)) => reach(robots, from, to, f64::from(*link)),
                _ => 0.0,
            }
        }
        Metric::LargestGroupArea { link, disc, within } => {
            let members = groups(robots, *link).members(robots);
            let members: Vec<[f64; 2]> = members.map(|robot| robot.at).collect();
            shapes::covered_area(&members, *disc, *within)
        }
        // `Tally::update` measures these itself. A new kind of metric must be added there or here.
        Metric::RobotsOn { .. }
        | Metric::MostRobotsOn { .. }
        | Metric::ObjectsOn { .. }
        | Metric::ObjectDistance { .. }
        | Metric::ObjectsHeld { .. }
        | Metric::TimeUntil { .. }
        | Metric::Returns { .. }
        | Metric::CrossingsSouth { .. }
        | Metric::RobotsInWrongHalf { .. }
        | Metric::StopErrors { .. }
        | Metric::MeanDistance { .. }
        | Metric::MeanDistanceInside { .. }
        | Metric::MeanDistanceRim { .. }
        | Metric::CellAge { .. }
        | Metric::VisitedShare { .. }
        | Metric::Caught { .. }
        | Metric::FlagsBrought { .. }
        | Metric::FlagsCarried { .. }
        | Metric::PaintedShare { .. }
        | Metric::Sum { .. } => 0.0,
    }
}

/// Returns the robots from left to right; robots with equal x keep their order.
#[inline]
fn from_left(robots: &[State]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..robots.len()).collect();
    order.sort_by(|a, b| robots[*a].at[0].total_cmp(&robots[*b].at[0]));
    order
}

/// Maximum number of robots for which all pairs are compared, and sets of robots are bit masks.
const FEW: usize = 64;

/// Returns the mean distance to the nearest other robot.
#[inline]
fn nearest(robots: &[State]) -> f64 {
    if robots.len() < 2 {
        return 0.0;
    }
    if robots.len() <= FEW {
        let mut least = [f64::INFINITY; FEW];
        for i in 0..robots.len() {
            for j in 0..i {
                let apart = square(robots[i].at, robots[j].at);
                least[i] = least[i].min(apart);
                least[j] = least[j].min(apart);
            }
        }
        let distances = least[..robots.len()].iter().map(|square| square.sqrt());
        return distances.sum::<f64>() / robots.len() as f64;
    }
    let order = from_left(robots);
    let mut distances = vec![0.0; robots.len()];
    for (position, index) in order.iter().enumerate() {
        let at = robots[*index].at;
        let mut least = f64::INFINITY;
        // Search outwards until the distance in x alone is too large.
        let mut look = |other: &usize| {
            let other = robots[*other].at;
            least = least.min(square(at, other));
            let aside = other[0] - at[0];
            aside * aside > least
        };
        let _ = order[position + 1..].iter().any(&mut look);
        let _ = order[..position].iter().rev().any(&mut look);
        distances[*index] = least.sqrt();
    }
    distances.iter().sum::<f64>() / robots.len() as f64
}

/// Groups of linked robots.
struct Groups {
    /// The largest group; the first one if there are several.
    largest: Members,
    size: usize,
    count: usize,
}

impl Groups {
    /// Returns the robots of the largest group.
    #[inline]
    fn members(self, robots: &[State]) -> impl Iterator<Item = &State> {
        let members = robots.iter().enumerate();
        members
            .filter(move |(index, _)| self.largest.has(*index))
            .map(|(_, robot)| robot)
    }
}

/// The set of robots in a group.
enum Members {
    Few(u64),
    /// The group of each robot, and the index of this group.
    Many(Vec<usize>, usize),
}

impl Members {
    #[inline]
    fn has(&self, robot: usize) -> bool {
        match self {
            Self::Few(bits) => bits >> robot & 1 == 1,
            Self::Many(groups, group) => groups[robot] == *group,
        }
    }
}

#[inline]
fn groups(robots: &[State], link: f32) -> Groups {
    let link = f64::from(link);
    if robots.len() > FEW {
        return many_groups(robots, link);
    }
    let mut neighbours = [0_u64; FEW];
    for i in 0..robots.len() {
        for j in 0..i {
            if square(robots[i].at, robots[j].at) < link * link {
                neighbours[i] |= 1 << j;
                neighbours[j] |= 1 << i;
            }
        }
    }
    let mut left = u64::MAX >> (FEW - robots.len());
    let (mut largest, mut count) = (0_u64, 0);
    while left != 0 {
        let mut group = left & left.wrapping_neg();
        let mut fresh = group;
        while fresh != 0 {
            let others = neighbours[fresh.trailing_zeros() as usize] & !group;
            fresh = fresh & (fresh - 1) | others;
            group |= others;
        }
        left &= !group;
        count += 1;
        if group.count_ones() > largest.count_ones() {
            largest = group;
        }
    }
    Groups {
        largest: Members::Few(largest),
        size: largest.count_ones() as usize,
        count,
    }
}

#[inline]
fn many_groups(robots: &[State], link: f64) -> Groups {
    let order = from_left(robots);
    let mut first: Vec<usize> = (0..robots.len()).collect();
    for (position, index) in order.iter().enumerate() {
        for other in &order[position + 1..] {
            let (a, b) = (robots[*index].at, robots[*other].at);
            if b[0] - a[0] >= link {
                break;
            }
            if square(a, b) < link * link {
                let (a, b) = (root(&mut first, *index), root(&mut first, *other));
                first[a.max(b)] = a.min(b);
            }
        }
    }
    let mut sizes = vec![0_usize; robots.len()];
    let mut largest = 0;
    for index in 0..robots.len() {
        let group = root(&mut first, index);
        first[index] = group;
        sizes[group] += 1;
    }
    for (group, size) in sizes.iter().enumerate() {
        if *size > sizes[largest] {
            largest = group;
        }
    }
    Groups {
        size: sizes[largest],
        count: sizes.iter().filter(|size| **size > 0).count(),
        largest: Members::Many(first, largest),
    }
}

/// Returns the first robot of a group, and shortens the path to it.
#[inline]
fn root(first: &mut [usize], mut index: usize) -> usize {
    while first[index] != index {
        first[index] = first[first[index]];
        index = first[index];
    }
    index
}

/// Returns the middles of the squares of the free floor.
#[inline]
fn squares(layout: &Place, side: f64) -> impl Iterator<Item = [f64; 2]> + '_ {
    let [low, high] = polygon::extent(&layout.outline).map(|corner| corner.map(f64::from));
    let count = |axis: usize| ((high[axis] - low[axis]) / side).ceil() as u64;
    let (columns, rows) = (count(0), count(1));
    (0..rows)
        .flat_map(move |row| (0..columns).map(move |column| [column, row]))
        .map(move |cell| {
            let at = |axis: usize| low[axis] + (cell[axis] as f64 + 0.5) * side;
            [at(0), at(1)]
        })
        .filter(|point| layout.is_free(*point))
}

/// Returns the share of squares whose middle is within `radius` of a robot.
#[inline]
fn covered(robots: &[State], layout: &Place, radius: f32, points: &mut Vec<[f64; 2]>) -> f64 {
    if points.is_empty() {
        let area = polygon::area(&layout.outline);
        let side = SQUARE.max((area / MOST_SQUARES).sqrt());
        points.extend(squares(layout, side));
    }
    let radius = f64::from(radius);
    let order = from_left(robots);
    let is_covered = |point: &&[f64; 2]| {
        let first = order.partition_point(|index| robots[*index].at[0] < point[0] - radius);
        order[first..]
            .iter()
            .map(|index| robots[*index].at)
            .take_while(|at| at[0] <= point[0] + radius)
            .any(|at| square(at, **point) <= radius * radius)
    };
    points.iter().filter(is_covered).count() as f64 / (points.len() as f64).max(1.0)
}

/// Squares that cover the arena.
pub(super) struct Grid {
    low: [f64; 2],
    side: f64,
    columns: usize,
    rows: usize,
}

impl Grid {
    #[inline]
    pub(super) fn new(layout: &Place, cell: f32) -> Self {
        let side = f64::from(cell);
        let [low, high] = polygon::extent(&layout.outline).map(|corner| corner.map(f64::from));
        let count = |axis: usize| ((high[axis] - low[axis]) / side).ceil() as usize;
        Self {
            low,
            side,
            columns: count(0),
            rows: count(1),
        }
    }

    /// Returns the number of squares.
    #[inline]
    pub(super) fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// Returns whether the middle of each square is on the free floor.
    #[inline]
    pub(super) fn free_squares(&self, layout: &Place) -> Vec<bool> {
        let mut free = vec![false; self.len()];
        for index in squares(layout, self.side).filter_map(|point| self.index(point)) {
            free[index] = true;
        }
        free
    }

    /// Returns the index of the square at a point.
    #[inline]
    pub(super) fn index(&self, [x, y]: [f64; 2]) -> Option<usize> {
        let of = |at: f64, axis: usize| ((at - self.low[axis]) / self.side).floor();
        let (column, row) = (of(x, 0), of(y, 1));
        let inside =
            column >= 0.0 && row >= 0.0 && column < self.columns as f64 && row < self.rows as f64;
        inside.then(|| row as usize * self.columns + column as usize)
    }
}

/// The visited squares of each lane.
pub(super) struct Visits {
    grid: Grid,
    /// Whether a square is free and not yet visited, lane after lane.
    fresh: Vec<bool>,
    /// Number of free squares.
    free: usize,
    /// Number of visited free squares, by lane.
    counts: [usize; MOST_LANES],
}

impl Visits {
    #[inline]
    pub(super) fn new(layout: &Place, cell: f32, lanes: usize) -> Self {
        let grid = Grid::new(layout, cell);
        let fresh = grid.free_squares(layout);
        Self {
            free: fresh.iter().filter(|free| **free).count(),
            fresh: fresh.repeat(lanes),
            grid,
            counts: [0; MOST_LANES],
        }
    }

    /// Marks the squares where the robots of a lane are, and returns the share of free squares visited so far.
    #[inline]
    pub(super) fn visit(&mut self, robots: &[State], lane: usize) -> f64 {
        let first = lane * self.grid.len();
        for robot in robots {
            if let Some(index) = self.grid.index(robot.at) {
                let fresh = &mut self.fresh[first + index];
                self.counts[lane] += usize::from(*fresh);
                *fresh = false;
            }
        }
        self.counts[lane] as f64 / (self.free as f64).max(1.0)
    }
}

/// Returns the share of the way from one point to another that a chain of robots spans, 0..1.
#[inline]
fn reach(robots: &[State], from: [f64; 2], to: [f64; 2], link: f64) -> f64 {
    let way = square(from, to).sqrt();
    if way <= link {
        return 1.0;
    }
    let linked = |a: [f64; 2], b: [f64; 2]| square(a, b) < link * link;
    let mut rest = way;
    if robots.len() <= FEW {
        let mut left = u64::MAX >> (FEW - robots.len());
        let mut ends = [[0.0; 2]; FEW + 1];
        ends[0] = from;
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let end = ends[count];
            rest = rest.min(square(end, to).sqrt());
            let mut others = left;
            while others != 0 {
                let other = others.trailing_zeros() as usize;
                others &= others - 1;
                if linked(end, robots[other].at) {
                    left &= !(1 << other);
                    ends[count] = robots[other].at;
                    count += 1;
                }
            }
        }
    } else {
        let mut others: Vec<[f64; 2]> = robots.iter().map(|robot| robot.at).collect();
        let mut ends = vec![from];
        while let Some(end) = ends.pop() {
            rest = rest.min(square(end, to).sqrt());
            others.retain(|other| {
                let is_linked = linked(end, *other);
                if is_linked {
                    ends.push(*other);
                }
                !is_linked
            });
        }
    }
    (1.0 - (rest - link) / (way - link)).clamp(0.0, 1.0)
}
