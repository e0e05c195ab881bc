//! Which messages arrive: loss, fading with the distance, collisions, and senders that do not send in every tick.
//!
//! Each link has one random number of 16 bits in a tick, which decides on all of these together. What robots without a
//! `radio` hear follows from the range and the loss alone.

use swarmwright_lanes::{Int, Lanes, Mask, Number, number};

use super::others::Others;
use crate::math::functions::{exp, ln};
use crate::math::random::{Keys, LINKS};
use crate::robots::{Links, Radio, Robot, Team};

/// What a robot receives in a tick, link by link.
pub(crate) struct Reception<'a, L: Lanes> {
    radio: Option<&'a Radio>,
    /// Below this a link's number means that its message is lost, where only `loss` matters.
    lost: L::Int,
    /// Probability that a message arrives, before fading.
    arriving: Number<L>,
    keys: Keys<L>,
    tick: u32,
    receiver: usize,
    /// The block of links that `words` are for.
    block: usize,
    words: [L::Int; 4],
}

impl<'a, L: Lanes> Reception<'a, L> {
    /// `loss`: probability of loss in this tick. `mute`: lanes in which robots send nothing; empty if all send.
    #[inline(always)]
    pub(crate) fn new(
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

    /// Whether the message of a sender arrives, if nothing stands between. `square`: of the distance, `range`: of the
    /// distance up to which it is heard, m^2.
    #[inline(always)]
    pub(crate) fn arrives(
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

/// Whether a robot sends in a tick: robots with an interval take turns.
#[inline(always)]
fn sends(robot: &Robot, index: usize, tick: u32) -> bool {
    let radio = robot.links.as_ref().and_then(|links| links.radio.as_ref());
    radio.is_none_or(|radio| (tick + index as u32).is_multiple_of(radio.interval))
}

/// How many robots within the range send in a tick.
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

/// Probability that the received power is above the threshold: its mean falls with the distance, and reaches the threshold
/// at the range; around the mean it is distributed as by Nakagami (1960), with a whole number as shape.
#[inline(always)]
fn received<L: Lanes>(radio: &Radio, square: Number<L>, range: Number<L>) -> Number<L> {
    let smallest = number(f32::MIN_POSITIVE);
    let ratio = (square / range.at_least(smallest)).at_least(smallest);
    let power = (ln(ratio) * (radio.exponent * 0.5)).within(-80.0, 5.0);
    let threshold = (exp(power) * radio.fading as f32).at_most(number(80.0));
    // The sum of threshold^k / k! for k below the shape, by Horner's rule.
    let mut sum = number::<L>(1.0);
    for k in (1..radio.fading).rev() {
        sum = sum * threshold * (1.0 / k as f32) + 1.0;
    }
    (exp(-threshold) * sum).at_most(number(1.0))
}

/// The square of the distance up to which a sender is heard, with fading on average, m^2: the shorter range of both; 0 of those that send nothing.
#[inline(always)]
pub(crate) fn both(links: &Links, sender: &Robot) -> f32 {
    let range = match &sender.links {
        Some(links) => links.range,
        None => 0.0,
    };
    let range = range.min(links.range);
    range * range
}
