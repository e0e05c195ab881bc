//! Reception of messages: loss, fading with distance, collisions, and senders that do not send in every tick.
//!
//! Each link has one 16-bit random number per tick, which decides all of these together. For robots without a `radio`,
//! only the range and the loss matter.

use swarmwright_lanes::{Int, Lanes, Mask, Number, number};

use super::others::Others;
use crate::math::functions::{exp, ln};
use crate::math::random::{Keys, LINKS};
use crate::robots::{Links, Radio, Robot, Team};

/// Reception of a robot in a tick, link by link.
pub struct Reception<'a, L: Lanes> {
    radio: Option<&'a Radio>,
    /// Random numbers up to this mean that a message is lost, if only `loss` matters.
    lost: L::Int,
    /// Probability that a message is received, before fading.
    arriving: Number<L>,
    keys: Keys<L>,
    tick: u32,
    receiver: usize,
    /// Block of links to which `words` belong.
    block: usize,
    words: [L::Int; 4],
}

impl<'a, L: Lanes> Reception<'a, L> {
    /// Creates the reception of a robot. `loss` is the probability of loss in this tick. `mute` has the lanes in which
    /// robots do not send; it is empty if all send.
    #[inline(always)]
    pub fn new(
        links: &'a Links,
        team: &Team,
        (others, indices): (&Others<L>, &[u32]),
        (loss, mute): (f32, &[L::Mask]),
        (keys, tick, receiver): (Keys<L>, u32, usize),
    ) -> Self {
        let mut arriving = number(1.0 - loss);
        if let Some(radio) = &links.radio
            && radio.crowding < 0.0
        {
            let sending = senders(links, team, others, indices, mute, tick);
            let rivals = (sending - number(1.0)).at_least(number(0.0));
            arriving *= exp((rivals * radio.crowding).at_least(number(-80.0)));
        }
        Self {
            radio: links.radio.as_ref(),
            lost: L::Int::splat((loss * 65536.0) as i32 - 1),
            arriving,
            keys,
            tick,
            receiver,
            block: usize::MAX,
            words: [L::Int::splat(0); 4],
        }
    }

    /// Returns whether a sender's message is received if nothing blocks it. `square` is the square of the distance,
    /// `range` the square of the maximum distance, m^2.
    #[inline(always)]
    pub fn arrives(
        &mut self,
        (sender, of): (usize, &Robot),
        square: Number<L>,
        range: Number<L>,
    ) -> L::Mask {
        if sender / LINKS != self.block {
            self.block = sender / LINKS;
            self.words = self.keys.links(self.tick, self.receiver, self.block);
        }
        let word = self.words[sender % LINKS / 2];
        let half = if sender.is_multiple_of(2) {
            word.and(L::Int::splat(0xFFFF))
        } else {
            word.shr(L::Int::splat(16))
        };
        let Some(radio) = self.radio else {
            return self.lost.lt(half).and(square.lt(range));
        };
        if !sends(of, sender, self.tick) {
            return L::Mask::from_bits(0);
        }
        let mut arriving = self.arriving;
        if radio.fading > 0 {
            arriving *= received(radio, square, range);
        }
        let least = (number::<L>(1.0) - arriving) * 65536.0;
        let lucky = least.lt(Number(L::from_int(half)) + 0.5);
        lucky.and(square.lt(range * (radio.stretch * radio.stretch)))
    }
}

/// Returns whether a robot sends in a tick; robots with an interval take turns.
#[inline(always)]
fn sends(robot: &Robot, index: usize, tick: u32) -> bool {
    let radio = robot.links.as_ref().and_then(|links| links.radio.as_ref());
    radio.is_none_or(|radio| (tick + index as u32).is_multiple_of(radio.interval))
}

/// Returns the number of robots within the range that send in a tick.
#[inline(always)]
fn senders<L: Lanes>(
    links: &Links,
    team: &Team,
    others: &Others<L>,
    indices: &[u32],
    mute: &[L::Mask],
    tick: u32,
) -> Number<L> {
    let mut count = number::<L>(0.0);
    let mut at = 0;
    for kind in 0..others.kinds() {
        let robot = team.kind(kind);
        let range = number::<L>(both(links, robot));
        for other in others.of(kind) {
            let sender = indices[at] as usize;
            at += 1;
            if !sends(robot, sender, tick) {
                continue;
            }
            let mut sent = other.square.lt(range);
            if !mute.is_empty() {
                sent = sent.and_not(mute[sender]);
            }
            count = count.add_where(number(1.0), sent);
        }
    }
    count
}

/// Returns the probability that the received power is above the threshold. The mean power falls with distance and
/// equals the threshold at the range. The power follows Nakagami (1960) fading with an integer shape parameter.
#[inline(always)]
fn received<L: Lanes>(radio: &Radio, square: Number<L>, range: Number<L>) -> Number<L> {
    let smallest = number(f32::MIN_POSITIVE);
    let ratio = (square / range.at_least(smallest)).at_least(smallest);
    let power = (ln(ratio) * (radio.exponent * 0.5)).within(-80.0, 5.0);
    let threshold = (exp(power) * radio.fading as f32).at_most(number(80.0));
    // The sum of threshold^k / k! for all k below the shape parameter, by Horner's rule.
    let mut sum = number::<L>(1.0);
    for k in (1..radio.fading).rev() {
        sum = sum * threshold * (1.0 / k as f32) + 1.0;
    }
    (exp(-threshold) * sum).at_most(number(1.0))
}

/// Returns the square of the maximum distance for a sender, m^2 (with fading, of the mean distance): the shorter range
/// of the two robots counts. It is 0 for robots that send nothing.
#[inline(always)]
pub fn both(links: &Links, sender: &Robot) -> f32 {
    let range = match &sender.links {
        Some(links) => links.range,
        None => 0.0,
    };
    let range = range.min(links.range);
    range * range
}
