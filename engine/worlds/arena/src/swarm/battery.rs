//! Batteries, which discharge over time and charge at stations.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use crate::bodies::Bodies;
use crate::math::functions::absolute;
use crate::place::Place;
use crate::robots::Team;
use crate::time::TICK;

/// Sets all actuators of robots with an empty battery to 0: they stand still and show no colour.
#[inline(always)]
pub fn stop<L: Lanes>(charges: &[Number<L>], row: usize, commands: &mut [L]) {
    for (robot, row) in commands.chunks_exact_mut(row).enumerate() {
        let left = number(0.0).lt(charges[robot]);
        for command in row {
            *command = Number(*command).only_where(left).0;
        }
    }
}

/// Adds the lanes in which each robot is mute because its battery is empty.
#[inline(always)]
pub fn mute<L: Lanes>(charges: &[Number<L>], mute: &mut Vec<L::Mask>) {
    mute.resize(charges.len(), L::Mask::from_bits(0));
    for robot in 0..charges.len() {
        mute[robot] = mute[robot].or(charges[robot].le(number(0.0)));
    }
}

/// Updates the charges for a tick. Batteries discharge with time and with the mean effort of the drive, and charge on
/// their station.
#[inline(always)]
pub fn update<L: Lanes>(
    team: &Team,
    layout: &Place,
    bodies: &Bodies<L>,
    commands: &[L],
    charges: &mut [Number<L>],
) {
    for (robot, row) in commands.chunks_exact(team.actuators()).enumerate() {
        let Some(battery) = &team.robot(robot).battery else {
            continue;
        };
        let standing = TICK / battery.standing;
        let drive = &row[team.drive(robot)];
        let more = (TICK / battery.driving - standing) / drive.len() as f32;
        let mut effort = number::<L>(0.0);
        for command in drive {
            effort += absolute(Number(*command)).at_most(number(1.0));
        }
        let charge = charges[robot];
        let used = effort * more + standing;
        let mut next = charge - used;
        // A remainder due to rounding does not last another tick.
        next = next.only_where((used * 0.5).lt(next));
        if let Some(charging) = &battery.charging {
            let shape = &layout.patches[charging.patch].shape;
            let on = shape.holds(bodies.x[robot], bodies.y[robot]);
            next = (charge + TICK / charging.duration).select(next, on);
        }
        charges[robot] = next.within(0.0, 1.0);
    }
}
