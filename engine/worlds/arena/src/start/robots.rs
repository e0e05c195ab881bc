//! Start positions of robots in an episode.

use swarmwright_simulation::counter::uniform;

use super::objects;
use crate::place::area::{pose, within};
use crate::place::{Form, Place, Pose, Start, to_face};
use crate::robots::Team;

/// Number of random draws for a robot before the round fails.
const TRIES: u64 = 2_000;
/// Number of rounds. If a robot does not fit, all robots are drawn again, because the others may block the remaining
/// space.
const ROUNDS: u64 = 8;
/// Identifies the random stream for start positions.
const STREAM: u64 = 0x0073_7461_7274;

/// Draws a pose for each robot, in the region of its kind. A pose that overlaps another robot, a wall or an object is drawn again.
///
/// # Errors
/// Returns the largest number of robots that were placed, if not all fit.
pub fn draw(
    starts: &[Start],
    team: &Team,
    (layout, objects): (&Place, &[(Form, Pose)]),
    seed: u64,
) -> Result<Vec<Pose>, usize> {
    let mut most = 0;
    for round in 0..ROUNDS {
        match round_of(starts, team, (layout, objects), seed, STREAM | round << 48) {
            Err(count) => most = most.max(count),
            poses => return poses,
        }
    }
    Err(most)
}

/// Makes one round of draws, with a random stream.
fn round_of(
    starts: &[Start],
    team: &Team,
    (layout, objects): (&Place, &[(Form, Pose)]),
    seed: u64,
    stream: u64,
) -> Result<Vec<Pose>, usize> {
    let mut poses: Vec<Pose> = Vec::with_capacity(team.len());
    let mut occupied = OccupiedCells::new(starts, team.len(), team.radius());
    for index in 0..team.len() as u64 {
        let start = &starts[team.group(index as usize)];
        let pose = (0..TRIES)
            .map(|attempt| {
                let number =
                    |part: u64| uniform(seed, stream, (index * TRIES + attempt) * 4 + part);
                pose(start, [number(0), number(1), number(2)])
            })
            .find(|pose| {
                within(pose.at, start) && fits(*pose, &poses, &occupied, team, (layout, objects))
            });
        let Some(pose) = pose else {
            return Err(poses.len());
        };
        occupied.add(pose.at, index as u32);
        poses.push(pose);
    }
    Ok(poses)
}

/// Robots in the cells of a grid, so that a robot is compared only with those nearby.
struct OccupiedCells {
    low: [f32; 2],
    side: f32,
    counts: [usize; 2],
    /// The most recently added robot of each cell, and for each robot the previous one in its cell.
    newest: Vec<u32>,
    before: Vec<u32>,
}

/// Marks the absence of a robot.
const NONE: u32 = u32::MAX;

impl OccupiedCells {
    fn new(starts: &[Start], robots: usize, radius: f32) -> Self {
        let region = |start: &Start| match (start.disc, start.rectangle) {
            (Some((center, radius)), _) => (
                center.map(|middle| middle - radius),
                center.map(|middle| middle + radius),
            ),
            (None, Some(corners)) => corners,
            (None, None) => ([0.0; 2], [0.0; 2]),
        };
        let regions = starts.iter().map(region);
        let all = regions.reduce(|(low, high), (least, most)| {
            let axes = [0, 1];
            (
                axes.map(|axis| low[axis].min(least[axis])),
                axes.map(|axis| high[axis].max(most[axis])),
            )
        });
        let (low, high) = all.unwrap_or_default();
        let extent = [high[0] - low[0], high[1] - low[1]];
        let side = (extent[0] * extent[1] / robots as f32)
            .sqrt()
            .max(extent[0].max(extent[1]) / robots as f32)
            .max(radius * 2.001);
        let counts = extent.map(|extent| (extent / side) as usize + 1);
        Self {
            low,
            side,
            counts,
            newest: vec![NONE; counts[0] * counts[1]],
            before: vec![NONE; robots],
        }
    }

    fn cell(&self, at: [f32; 2]) -> [usize; 2] {
        let of = |axis: usize| {
            let cell = ((at[axis] - self.low[axis]) / self.side) as usize;
            cell.min(self.counts[axis] - 1)
        };
        [of(0), of(1)]
    }

    fn add(&mut self, at: [f32; 2], robot: u32) {
        let [column, row] = self.cell(at);
        let newest = &mut self.newest[row * self.counts[0] + column];
        self.before[robot as usize] = std::mem::replace(newest, robot);
    }

    /// Returns the robots in the cell of a point and in the adjacent cells.
    fn around(&self, at: [f32; 2]) -> impl Iterator<Item = u32> + '_ {
        let [column, row] = self.cell(at);
        let rows = row.saturating_sub(1)..=(row + 1).min(self.counts[1] - 1);
        let last = (column + 1).min(self.counts[0] - 1);
        rows.flat_map(move |row| (column.saturating_sub(1)..=last).map(move |column| (column, row)))
            .flat_map(move |(column, row)| {
                let robot_of = |robot: u32| (robot != NONE).then_some(robot);
                let newest = robot_of(self.newest[row * self.counts[0] + column]);
                std::iter::successors(newest, move |robot| robot_of(self.before[*robot as usize]))
            })
    }
}

fn fits(
    pose: Pose,
    others: &[Pose],
    occupied: &OccupiedCells,
    team: &Team,
    (layout, objects): (&Place, &[(Form, Pose)]),
) -> bool {
    let [x, y] = pose.at;
    // Radius of the robot to place.
    let radius = team.robot(others.len()).radius;
    let apart =
        |way: [f32; 2], distance: f32| way[0] * way[0] + way[1] * way[1] >= distance * distance;
    layout.faces.iter().all(|face| {
        let way = to_face::<f32>(
            face,
            swarmwright_lanes::Number(x),
            swarmwright_lanes::Number(y),
        );
        apart(way.map(|number| number.0), radius)
    }) && occupied.around(pose.at).all(|other| {
        let [ox, oy] = others[other as usize].at;
        apart([ox - x, oy - y], radius + team.robot(other as usize).radius)
    }) && objects
        .iter()
        .all(|object| objects::distance(*object, pose.at) >= radius)
        && layout.is_free(pose.at.map(f64::from))
}
