//! Machines of modules in lanes: each lane is in a state of its own.

use swarmwright_lanes::{Int, Lanes, Mask};

use super::behaviours::act_in_lanes;
use super::conditions::{ground_in_lanes, probability_in_lanes};
use super::random::LaneRandom;
use super::{
    Form, MOST_STATES, MOST_TRANSITIONS, Modules, OF_STATE, OF_TRANSITION, SENSORS, STATE_LIMITS,
    TRANSITION_LIMITS,
};
use crate::kinds::{Kind, LaneKind};

impl LaneKind for Modules {
    #[inline(always)]
    fn lane_weights(&self) -> usize {
        self.weight_count().unwrap_or(usize::MAX)
    }

    /// Limits all weights once.
    #[inline(always)]
    fn prepare<L: Lanes>(&self, weights: &mut [L]) {
        let (first, rows) = weights.split_at_mut(1);
        first[0] = limited(first[0], (1.0, self.states as f32, false));
        let last = first[0].sub(L::splat(1.0));
        for row in rows.chunks_exact_mut(self.row_length()) {
            let (state, transitions) = row.split_at_mut(OF_STATE);
            for (weight, limits) in state.iter_mut().zip(STATE_LIMITS) {
                *weight = limited(*weight, limits);
            }
            state[3] = state[3].at_most(L::splat(self.transitions as f32));
            for transition in transitions.chunks_exact_mut(OF_TRANSITION) {
                for (weight, limits) in transition.iter_mut().zip(TRANSITION_LIMITS) {
                    *weight = limited(*weight, limits);
                }
                transition[0] = transition[0].at_most(last);
            }
        }
    }

    #[inline(always)]
    fn step_slice_in_lanes<L: Lanes>(
        &self,
        (weights, _): (&[L], &[&[f32]]),
        state: &mut [L],
        _scratch: &mut [L],
        sensors: &[L],
        actuators: &mut [L],
    ) {
        let sensors = &sensors[..SENSORS];
        let current = state[0].floor();
        let none = L::Mask::from_bits(0);
        let mut row = Row {
            weights: &weights[1..],
            length: self.row_length(),
            states: self.states,
            is: [none; MOST_STATES],
        };
        for index in 1..self.states {
            row.is[index] = current.eq(L::Int::splat(index as i32));
        }
        let random = LaneRandom::new(sensors[SENSORS - 1]);
        if self.form == Form::Tree {
            self.tick_lanes(weights, state, sensors, random, actuators);
            return;
        }
        let [left, right] = act_in_lanes(&row, &mut state[2], sensors, random);
        (actuators[0], actuators[1]) = (left, right);
        self.change(&row, state, sensors, random);
    }
}

#[inline(always)]
fn limited<L: Lanes>(weight: L, (low, high, fraction): (f32, f32, bool)) -> L {
    let within = weight.at_least(L::splat(low)).at_most(L::splat(high));
    if fraction {
        within
    } else {
        L::from_int(within.floor())
    }
}

#[inline(always)]
pub(super) fn length<L: Lanes>([x, y]: [L; 2]) -> L {
    x.mul(x).add(y.mul(y)).sqrt()
}

/// The weights of all states, and in which of them each lane is.
pub(super) struct Row<'a, L: Lanes> {
    weights: &'a [L],
    length: usize,
    states: usize,
    is: [L::Mask; MOST_STATES],
}

impl<L: Lanes> Row<'_, L> {
    /// The weight of each lane's state with this place in its row.
    #[inline(always)]
    pub(super) fn get(&self, index: usize) -> L {
        let mut weight = self.weights[index];
        for state in 1..self.states {
            weight = self.weights[state * self.length + index].select(weight, self.is[state]);
        }
        weight
    }
}

/// 1 where a condition holds, else 0.
#[inline(always)]
fn one_where<L: Lanes>(condition: L::Mask) -> L::Int {
    L::Int::splat(1).select(L::Int::splat(0), condition)
}

impl Modules {
    /// A step of trees: each lane goes on from its subtree to the first whose condition does not hold, which acts.
    #[inline(always)]
    fn tick_lanes<L: Lanes>(
        &self,
        weights: &[L],
        state: &mut [L],
        sensors: &[L],
        random: LaneRandom<L>,
        actuators: &mut [L],
    ) {
        let (zero, none) = (L::splat(0.0), L::Mask::from_bits(0));
        let mut row = Row {
            weights: &weights[1..],
            length: self.row_length(),
            states: self.states,
            is: [none; MOST_STATES],
        };
        let count = weights[0].floor();
        let ground = ground_in_lanes(sensors[4]);
        let mut current = state[0].floor();
        let mut going = current.lt(count);
        for index in 0..self.states {
            let number = L::Int::splat(index as i32);
            let active = current.eq(number).and(going).and(number.lt(count));
            if !active.any() {
                continue;
            }
            let only = Row {
                weights: &row.weights[index * row.length..],
                length: row.length,
                states: 1,
                is: row.is,
            };
            let probability = probability_in_lanes(&only, OF_STATE, ground, sensors[5]);
            let holds = random.unit(index).lt(probability).and(active);
            going = going.and_not(active.and_not(holds));
            current = current.add(one_where::<L>(holds));
            state[2] = zero.select(state[2], holds);
        }
        for index in 1..self.states {
            row.is[index] = current.eq(L::Int::splat(index as i32));
        }
        // Those that have come to the end do what some subtree does, which does not count.
        let ended = count.eq(current);
        let [left, right] = act_in_lanes(&row, &mut state[2], sensors, random);
        actuators[0] = zero.select(left, ended);
        actuators[1] = zero.select(right, ended);
        state[0] = zero.select(L::from_int(current), ended);
        state[2] = zero.select(state[2], ended);
    }

    /// Makes transitions.
    #[inline(always)]
    fn change<L: Lanes>(
        &self,
        row: &Row<'_, L>,
        state: &mut [L],
        sensors: &[L],
        random: LaneRandom<L>,
    ) {
        #[expect(clippy::disallowed_names, reason = "the number 1")]
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let count = row.get(3).floor();
        let settled = zero.lt(state[1]);
        let ground = ground_in_lanes(sensors[4]);
        let mut holds = [L::Mask::from_bits(0); MOST_TRANSITIONS];
        let mut held = L::Int::splat(0);
        for (index, holds) in holds[..self.transitions].iter_mut().enumerate() {
            let first = OF_STATE + index * OF_TRANSITION;
            let present = L::Int::splat(index as i32).lt(count).and(settled);
            if present.any() {
                let probability = probability_in_lanes(row, first, ground, sensors[5]);
                *holds = random.unit(index).lt(probability).and(present);
                held = held.add(one_where::<L>(*holds));
            }
        }
        state[1] = one;
        let changes = L::Int::splat(0).lt(held);
        if !changes.any() {
            return;
        }
        let mut rest = random.choice(held);
        let mut target = state[0];
        for (index, holds) in holds[..self.transitions].iter().enumerate() {
            let chosen = rest.eq(L::Int::splat(0)).and(*holds);
            target = row
                .get(OF_STATE + index * OF_TRANSITION)
                .select(target, chosen);
            rest = rest.sub(one_where::<L>(*holds));
        }
        state[0] = target;
        state[1] = zero.select(one, changes);
        state[2] = zero.select(state[2], changes);
    }
}
