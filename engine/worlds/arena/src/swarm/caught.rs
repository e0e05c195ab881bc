//! Robots that are caught: they stand, show no colour and are not heard.

use swarmwright_lanes::{Lanes, Mask, Number, number};

/// Sets all actuators of caught robots to 0.
#[inline(always)]
pub(super) fn stop<L: Lanes>(caught: &[L::Mask], row: usize, commands: &mut [L]) {
    for (row, caught) in commands.chunks_exact_mut(row).zip(caught) {
        if !caught.any() {
            continue;
        }
        for command in row {
            *command = number::<L>(0.0).select(Number(*command), *caught).0;
        }
    }
}

/// Adds the lanes in which each robot is mute because it is caught.
#[inline(always)]
pub(super) fn mute<L: Lanes>(caught: &[L::Mask], mute: &mut Vec<L::Mask>) {
    mute.resize(caught.len(), L::Mask::from_bits(0));
    for (mute, caught) in mute.iter_mut().zip(caught) {
        *mute = mute.or(*caught);
    }
}
