//! Machines of modules in lanes: each lane is in a state of its own.

use swarmwright_lanes::{Int, Lanes, Mask};

use super::catalogue::{BEHAVIOURS, Behaviour, CONDITIONS, Condition, Ground};
use super::random::LaneRandom;
use super::{
    BLACK, Form, MOST_STATES, MOST_TRANSITIONS, Modules, NEAR, OF_STATE, OF_TRANSITION, SENSORS,
    SHORT, STATE_LIMITS, TRANSITION_LIMITS, WHITE,
};
use crate::functions::lanes::sigmoid;
use crate::kinds::{Kind, LaneKind};
use crate::lanes::sums::is_one;

impl LaneKind for Modules {
    #[inline(always)]
    fn lane_weights(&self) -> usize {
        self.weight_count().unwrap_or(usize::MAX)
    }

    #[inline(always)]
    fn lane_state_length(&self) -> usize {
        3
    }

    /// The sensors.
    #[inline(always)]
    fn lane_scratch_length(&self) -> usize {
        SENSORS
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
    fn step_in_lanes<L: Lanes, const S: usize, const B: usize>(
        &self,
        (weights, _): (&[L], &[&[f32]]),
        state: &mut [L],
        scratch: &mut [L],
        numbers: [L; S],
        (bits, order): (L::Int, [u32; B]),
        actuators: &mut [L],
    ) {
        for (sensor, number) in scratch.iter_mut().zip(numbers) {
            *sensor = number;
        }
        for (sensor, bit) in scratch.iter_mut().skip(S).zip(order) {
            *sensor = L::splat(1.0).select(L::splat(0.0), is_one::<L>(bits, bit));
        }
        self.step_with(weights, state, scratch, actuators);
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
        self.step_with(weights, state, sensors, actuators);
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
fn length<L: Lanes>([x, y]: [L; 2]) -> L {
    x.mul(x).add(y.mul(y)).sqrt()
}

/// The weights of all states, and in which of them each lane is.
struct Row<'a, L: Lanes> {
    weights: &'a [L],
    length: usize,
    states: usize,
    is: [L::Mask; MOST_STATES],
}

impl<L: Lanes> Row<'_, L> {
    /// The weight of each lane's state with this place in its row.
    #[inline(always)]
    fn get(&self, index: usize) -> L {
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
    #[inline(always)]
    fn step_with<L: Lanes>(
        &self,
        weights: &[L],
        state: &mut [L],
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
        let [left, right] = act(&row, &mut state[2], sensors, random);
        (actuators[0], actuators[1]) = (left, right);
        self.change(&row, state, sensors, random);
    }

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
        let ground = ground(sensors[4]);
        let mut current = state[0].floor();
        let mut going = current.lt(count);
        for index in 0..self.states {
            let number = L::Int::splat(index as i32);
            let here = current.eq(number).and(going).and(number.lt(count));
            if !here.any() {
                continue;
            }
            let only = Row {
                weights: &row.weights[index * row.length..],
                length: row.length,
                states: 1,
                is: row.is,
            };
            let probability = probability(&only, OF_STATE, ground, sensors[5]);
            let holds = random.unit(index).lt(probability).and(here);
            going = going.and_not(here.and_not(holds));
            current = current.add(one_where::<L>(holds));
            state[2] = zero.select(state[2], holds);
        }
        for index in 1..self.states {
            row.is[index] = current.eq(L::Int::splat(index as i32));
        }
        // Those that have come to the end do what some subtree does, which does not count.
        let ended = count.eq(current);
        let [left, right] = act(&row, &mut state[2], sensors, random);
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
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let count = row.get(3).floor();
        let settled = zero.lt(state[1]);
        let ground = ground(sensors[4]);
        let mut holds = [L::Mask::from_bits(0); MOST_TRANSITIONS];
        let mut held = L::Int::splat(0);
        for (index, holds) in holds[..self.transitions].iter_mut().enumerate() {
            let first = OF_STATE + index * OF_TRANSITION;
            let there = L::Int::splat(index as i32).lt(count).and(settled);
            if there.any() {
                let probability = probability(row, first, ground, sensors[5]);
                *holds = random.unit(index).lt(probability).and(there);
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

/// The number of the condition that holds on the ground: see `CONDITIONS`.
#[inline(always)]
fn ground<L: Lanes>(sensor: L) -> L::Int {
    let number = |ground: Ground| {
        let place = CONDITIONS
            .iter()
            .position(|(_, condition)| *condition == Condition::Ground(ground));
        L::Int::splat(place.map_or(-1, |place| place as i32))
    };
    let bright = number(Ground::White).select(number(Ground::Grey), L::splat(WHITE).le(sensor));
    number(Ground::Black).select(bright, sensor.le(L::splat(BLACK)))
}

/// The probability that a transition, whose weights begin at `first`, may be made.
#[inline(always)]
fn probability<L: Lanes>(row: &Row<'_, L>, first: usize, ground: L::Int, neighbours: L) -> L {
    let condition = row.get(first + 1).floor();
    let none = L::Mask::from_bits(0);
    let is = |wanted: Condition| {
        let places = CONDITIONS
            .iter()
            .enumerate()
            .filter(|(_, (_, one))| *one == wanted);
        places.fold(none, |mask, (place, _)| {
            mask.or(condition.eq(L::Int::splat(place as i32)))
        })
    };
    let fixed = condition.eq(ground).or(is(Condition::Fixed));
    let simple = row.get(first + 2).select(L::splat(0.0), fixed);
    let (many, few) = (is(Condition::Neighbours), is(Condition::FewNeighbours));
    let counted = many.or(few);
    if !counted.any() {
        return simple;
    }
    let more = neighbours.sub(row.get(first + 3));
    let signed = more.neg().select(more, few);
    sigmoid(row.get(first + 4).mul(signed)).select(simple, counted)
}

/// What the behaviours of the lanes' states do: the speeds of both wheels.
#[inline(always)]
fn act<L: Lanes>(row: &Row<'_, L>, turn: &mut L, sensors: &[L], random: LaneRandom<L>) -> [L; 2] {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let behaviour = row.get(0).floor();
    let none = L::Mask::from_bits(0);
    let proximity = [sensors[0], sensors[1]];
    let (mut explores, mut follows) = (none, none);
    let (mut light, mut neighbours, mut squared, mut obstacles) = (zero, zero, zero, zero);
    for (place, (_, one)) in BEHAVIOURS.iter().enumerate() {
        let is = behaviour.eq(L::Int::splat(place as i32));
        match one {
            Behaviour::Explore => explores = explores.or(is),
            Behaviour::Stop => {}
            Behaviour::Follow(pull) => {
                follows = follows.or(is);
                light = L::splat(pull.light).select(light, is);
                neighbours = L::splat(pull.neighbours).select(neighbours, is);
                squared = L::splat(pull.squared).select(squared, is);
                obstacles = L::splat(pull.obstacles).select(obstacles, is);
            }
        }
    }
    let (mut left, mut right) = (zero, zero);
    if explores.any() {
        let (to_left, to_right) = (zero.lt(*turn), turn.lt(zero));
        left = one.select(left, explores);
        right = left;
        left = one.neg().select(left, explores.and(to_left));
        right = one.neg().select(right, explores.and(to_right));
        let near = L::splat(NEAR).le(length(proximity));
        let ahead = near.and(zero.le(proximity[0]));
        let begins = explores.and(ahead).and_not(to_left.or(to_right));
        if begins.any() {
            let steps = random.turn(row.get(1).floor());
            let steps = L::from_int(steps).at_least(one);
            let signed = steps.select(steps.neg(), proximity[1].lt(zero));
            *turn = signed.select(*turn, begins);
        }
        let turned = one.neg().select(one, to_right);
        let turned = turn.sub(turned);
        *turn = turned.select(*turn, explores.and(to_left.or(to_right)));
    }
    if follows.any() {
        let alpha = row.get(2);
        let neighbours = neighbours.add(squared.mul(alpha)).mul(alpha);
        let sum = |axis: usize| {
            light
                .mul(sensors[2 + axis])
                .add(neighbours.mul(sensors[6 + axis]))
                .add(obstacles.mul(proximity[axis]))
        };
        let [steered_left, steered_right] = follow(sum(0), sum(1));
        left = steered_left.select(left, follows);
        right = steered_right.select(right, follows);
    }
    [left, right]
}

#[inline(always)]
fn follow<L: Lanes>(x: L, y: L) -> [L; 2] {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let length = length([x, y]);
    let short = length.lt(L::splat(SHORT));
    let (x, y) = (one.select(x, short), zero.select(y, short));
    let inner = x.div(one.select(length, short));
    let inner = zero.select(inner, inner.is_nan());
    let inner = inner.at_most(one).at_least(one.neg());
    let to_left = zero.lt(y);
    [inner.select(one, to_left), one.select(inner, to_left)]
}
