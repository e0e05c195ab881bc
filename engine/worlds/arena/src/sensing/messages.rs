//! The values that robots send each other in messages.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::links::{self, LinkWindow};
use super::others::Others;
use super::radio::{Reception, both};
use crate::bodies::Bodies;
use crate::math::random::Keys;
use crate::place::Place;
use crate::robots::{Robot, Team};

/// Writes the mean of the messages that a robot receives in a tick, value by value, over the messages that have the
/// value; 0 without messages.
///
/// The same messages are received as for the count. `lacking` is scratch memory that counts the messages without each
/// value; it is empty if all messages have the same length.
#[expect(clippy::too_many_arguments, reason = "what a tick consists of")]
#[inline(always)]
pub fn hear<L: Lanes>(
    (robot, team): (&Robot, &Team),
    layout: &Place,
    bodies: &Bodies<L>,
    index: usize,
    (sent, others, indices): (&[Number<L>], &Others<L>, &[u32]),
    window: &LinkWindow<L>,
    (keys, tick): (Keys<L>, u32),
    (means, lacking): (&mut [L], &mut [Number<L>]),
) {
    means.fill(L::splat(0.0));
    lacking.fill(number(0.0));
    let Some(links) = &robot.links else {
        return;
    };
    let loss = window.loss(links);
    let mut reception = Reception::new(
        links,
        team,
        (others, indices),
        (loss, &window.mute),
        (keys, tick, index),
    );
    let (mut kind, mut left) = (0, 0);
    let mut range = number::<L>(0.0);
    let mut heard = number::<L>(0.0);
    let position = [bodies.x[index], bodies.y[index]];
    for at in 0..others.len() {
        let (other, sender) = (others[at], indices[at] as usize);
        while left == 0 {
            range = number(both(links, team.kind(kind)));
            left = others.of(kind).len();
            kind += 1;
        }
        left -= 1;
        let of = team.kind(kind - 1);
        let mut arrives = reception.arrives((sender, of), other.square, range);
        if !window.mute.is_empty() {
            arrives = arrives.and_not(window.mute[sender]);
        }
        if !arrives.any() {
            continue;
        }
        let way = [other.x, other.y];
        if links.line_of_sight() {
            arrives = arrives
                .and_not(links::behind_robot(team, way, other.square, others))
                .and_not(links::behind_wall(layout, position, way))
                .and_not(bodies.objects.hide(position, way));
        }
        heard = heard.add_where(number(1.0), arrives);
        for part in 0..of.message.min(means.len()) {
            let number = sent[sender * means.len() + part];
            means[part] = Number(means[part]).add_where(number, arrives).0;
        }
        for part in of.message..lacking.len() {
            lacking[part] = lacking[part].add_where(number(1.0), arrives);
        }
    }
    let share = number::<L>(1.0) / heard.at_least(number(1.0));
    for part in 0..means.len() {
        let share = match lacking.get(part) {
            None => share,
            Some(lacking) => number::<L>(1.0) / (heard - *lacking).at_least(number(1.0)),
        };
        means[part] = (Number(means[part]) * share).0;
    }
}
