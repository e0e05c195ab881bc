//! Lanes compute what one controller at a time computes, to the bit, in every instruction set.
#![allow(clippy::unwrap_used)] // helpers of tests

use proptest::prelude::*;
use serde_json::json;
use swarmwright_controllers::{Controller, LaneController, NodeActivation, Specification};
use swarmwright_lanes::{Int, Kernel, Lanes, Level};

/// Steps every lane's controller through the sensors of its lane, `S` numbers and `B` bits; the outputs lane by
/// lane.
struct Steps<'a, const S: usize, const B: usize> {
    /// As a slice rather than an array.
    sliced: bool,
    specifications: &'a [Specification],
    /// By step, then lane.
    sensors: &'a [Vec<Vec<f32>>],
}

impl<const S: usize, const B: usize> Kernel for Steps<'_, S, B> {
    type Output = Vec<Vec<f32>>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Vec<Vec<f32>> {
        let architecture = self.specifications[0].architecture();
        let mut outputs = vec![Vec::new(); self.specifications.len()];
        for (block, specifications) in self.specifications.chunks_exact(L::WIDTH).enumerate() {
            let mut controllers = LaneController::<L>::new(architecture);
            let genomes: Vec<&[f32]> = specifications.iter().map(Specification::weights).collect();
            controllers.load(&genomes);
            let mut state = vec![L::splat(0.0); controllers.state_length()];
            let mut actuators = vec![L::splat(0.0); architecture.actuators()];
            let first = block * L::WIDTH;
            for step in self.sensors {
                let sensor = |sensor: usize| {
                    let lanes = (0..L::WIDTH).map(|lane| step[first + lane][sensor]);
                    L::load(&lanes.collect::<Vec<_>>())
                };
                let numbers: [L; S] = std::array::from_fn(sensor);
                // Other bits do not count.
                let mut bits = L::Int::splat(!((1 << B) - 1) << 3);
                for bit in 0..B {
                    let is_zero = sensor(S + bit).le(L::splat(0.0));
                    let bit = L::Int::splat(8 << bit);
                    bits = bits.or(bit.select(L::Int::splat(0), is_zero));
                }
                let order = std::array::from_fn::<u32, B, _>(|bit| bit as u32 + 3);
                if self.sliced {
                    let all: Vec<L> = (0..S + B).map(sensor).collect();
                    controllers.step_slice(&mut state, &all, &mut actuators);
                } else if B == 0 {
                    controllers.step(&mut state, numbers, &mut actuators);
                } else {
                    controllers.step_with_bits(&mut state, numbers, (bits, order), &mut actuators);
                    for actuator in &mut actuators {
                        let number = L::splat(0.0).select(*actuator, actuator.is_nan());
                        *actuator = number.at_most(L::splat(1.0)).at_least(L::splat(-1.0));
                    }
                }
                for actuator in &actuators {
                    let mut lanes = vec![0.0; L::WIDTH];
                    actuator.store(&mut lanes);
                    for (lane, value) in lanes.into_iter().enumerate() {
                        outputs[first + lane].push(value);
                    }
                }
            }
        }
        outputs
    }
}

/// How many sensors are numbers, how many are bits.
const SENSORS: [(usize, usize); 5] = [(1, 0), (9, 0), (6, 3), (2, 8), (0, 3)];

/// The outputs in lanes of an instruction set, lane by lane.
fn outputs(
    (numbers, bits): (usize, usize),
    sliced: bool,
    level: Level,
    specifications: &[Specification],
    sensors: &[Vec<Vec<f32>>],
) -> Vec<Vec<f32>> {
    macro_rules! run {
        ($($s:literal, $c:literal);*) => {
            match (numbers, bits) {
                $(($s, $c) => level.run(Steps::<'_, $s, $c> { sliced, specifications, sensors }),)*
                other => panic!("{other:?} is not among those that were compiled"),
            }
        };
    }
    run!(1, 0; 9, 0; 6, 3; 2, 8; 0, 3)
}

fn architecture(sensors: usize) -> impl Strategy<Value = serde_json::Value> {
    let range = prop::sample::select(vec![[-1.0, 1.0], [0.0, 1.0], [-3.0, 2.5]]);
    let layered = (
        prop::collection::vec(1usize..6, 0..3),
        prop::sample::select(vec!["tanh", "sigmoid", "relu", "clamp", "linear"]),
    )
        .prop_map(|(hidden, activation)| json!({"kind": "layered", "hidden": hidden, "activation": activation}));
    let meshed = (0usize..5, 1u32..4, prop::sample::select(vec!["tanh", "sigmoid", "relu", "clamp"])).prop_map(
        |(hidden, iterations, activation)| {
            json!({"kind": "fully_meshed", "hidden": hidden, "iterations": iterations, "activation": activation})
        },
    );
    let network = (prop_oneof![layered, meshed], range).prop_map(|(mut specification, range)| {
        specification["output_range"] = json!(range);
        specification
    });
    let machine = (1usize..5, prop::collection::vec(thresholds(), 5)).prop_map(
        |(states, thresholds)| json!({"kind": "mealy_fsm", "states": states, "thresholds": thresholds}),
    );
    let evostick = Just(json!({"kind": "evostick"}));
    let machines = (1usize..6, 1usize..5)
        .prop_map(|(states, transitions)| json!({"kind": "modules", "states": states, "transitions": transitions}));
    let trees = (1usize..5).prop_map(
        |states| json!({"kind": "modules", "form": "tree", "states": states, "transitions": 1}),
    );
    let modules = prop_oneof![machines, trees];
    let hebbian = (0usize..4, 1u32..4).prop_map(
        |(hidden, iterations)| json!({"kind": "hebbian", "hidden": hidden, "iterations": iterations}),
    );
    let hears = prop::collection::vec(0..sensors + 3, 0..6);
    let neat = (prop::collection::vec(hears, 3..6), 1u32..4).prop_map(
        |(sources, iterations)| json!({"kind": "neat", "sources": sources, "iterations": iterations}),
    );
    let growing = (0usize..5, 1usize..12, any::<bool>(), 0..NodeActivation::ALL.len()).prop_map(
        |(nodes, connections, recurrent, activation)| {
            json!({"kind": "growing", "nodes": nodes, "connections": connections, "recurrent": recurrent,
                "output_activation": NodeActivation::ALL[activation].name(), "output_range": [-0.5, 2]})
        },
    );
    let any = prop_oneof![4 => network, 2 => machine, 1 => evostick, 5 => modules, 2 => hebbian, 2 => neat,
        4 => growing];
    (any, 1usize..4).prop_map(move |(mut specification, actuators)| {
        let mut actuators = actuators;
        if specification["kind"] == "modules" {
            if sensors == 9 {
                actuators = 2;
            } else {
                specification = json!({"kind": "evostick"});
            }
        }
        specification["version"] = json!(1);
        specification["sensors"] = json!(sensors);
        specification["actuators"] = json!(actuators);
        if let Some(thresholds) = specification.get_mut("thresholds") {
            // Those behind the fifth are not looked at.
            thresholds
                .as_array_mut()
                .unwrap()
                .resize(sensors, json!([]));
        }
        specification
    })
}

/// At most three, whole multiples of a half, so that readings meet them exactly.
fn thresholds() -> impl Strategy<Value = Vec<f32>> {
    prop::collection::btree_set(-4i8..=4, 0..3).prop_map(|halves| {
        halves
            .into_iter()
            .map(|half| f32::from(half) / 2.0)
            .collect()
    })
}

/// Readings of every size, thresholds among them.
fn reading() -> impl Strategy<Value = f32> {
    prop_oneof![4 => -2.0f32..2.0, 1 => (-4i8..=4).prop_map(|half| f32::from(half) / 2.0)]
}

/// Weights of every size: large ones overflow, and what comes of it must agree too.
fn weight() -> impl Strategy<Value = f32> {
    prop_oneof![8 => -4.0f32..4.0, 1 => -1e30f32..1e30, 1 => prop::sample::select(vec![0.0, -0.0, 3e38])]
}

/// All instruction sets compute what one controller at a time computes.
fn agree(
    split: (usize, usize),
    specifications: &[Specification],
    sensors: &[Vec<Vec<f32>>],
) -> Result<(), TestCaseError> {
    let expected: Vec<Vec<u32>> = specifications
        .iter()
        .enumerate()
        .map(|(lane, specification)| {
            let mut controller = Controller::new(specification);
            let mut actuators = vec![0.0; controller.actuators()];
            sensors
                .iter()
                .flat_map(|step| {
                    controller.step(&step[lane], &mut actuators).unwrap();
                    actuators
                        .iter()
                        .map(|value| value.to_bits())
                        .collect::<Vec<_>>()
                })
                .collect()
        })
        .collect();
    for level in Level::available() {
        for sliced in [false, true] {
            let actual: Vec<Vec<u32>> = outputs(split, sliced, level, specifications, sensors)
                .into_iter()
                .map(|lane| lane.into_iter().map(f32::to_bits).collect())
                .collect();
            prop_assert_eq!(&actual, &expected, "{}, sliced: {}", level.name(), sliced);
        }
    }
    Ok(())
}

/// Genes of a machine of four states with four transitions each, most of them within their limits.
fn machine_of_modules() -> impl Strategy<Value = Vec<f32>> {
    let of = |low: f32, high: f32| prop_oneof![9 => low..high, 1 => (0.95f32..1.05).prop_map(move |share| share * high)];
    let transition = (
        of(0.0, 4.0),
        of(0.0, 6.0),
        of(0.0, 1.0),
        of(1.0, 11.0),
        of(0.0, 20.0),
    );
    let state = (
        of(0.0, 6.0),
        of(1.0, 20.0),
        of(1.0, 5.0),
        of(1.0, 5.0),
        prop::collection::vec(transition, 4),
    );
    (of(1.0, 5.0), prop::collection::vec(state, 4)).prop_map(|(states, rows)| {
        let mut weights = vec![states];
        for (behaviour, rwm, alpha, count, transitions) in rows {
            weights.extend([behaviour, rwm, alpha, count]);
            for (target, condition, probability, xi, eta) in transitions {
                weights.extend([target, condition, probability, xi, eta]);
            }
        }
        weights
    })
}

/// What a robot senses: see `Modules`.
fn sensed() -> impl Strategy<Value = Vec<f32>> {
    let axis = || prop_oneof![1 => Just(0.0f32), 3 => -0.8f32..0.8];
    let ground = prop::sample::select(vec![0.0f32, 0.1, 0.5, 0.95, 1.0]);
    let vectors = ((axis(), axis()), (axis(), axis()), (axis(), axis()));
    (vectors, ground, 0u8..20, 0u32..1 << 24).prop_map(
        |((proximity, light, attraction), ground, neighbours, random)| {
            let random = random as f32 / 16_777_216.0;
            vec![
                proximity.0,
                proximity.1,
                light.0,
                light.1,
                ground,
                f32::from(neighbours),
                attraction.0,
                attraction.1,
                random,
            ]
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn machines_of_modules_agree_over_many_steps(
        machines in prop::collection::vec(machine_of_modules(), 16),
        sensed in prop::collection::vec(sensed(), 16 * 60),
    ) {
        let specification = |weights: &Vec<f32>| {
            let document = json!({"version": 1, "kind": "modules", "sensors": 9, "actuators": 2, "states": 4, "transitions": 4,
                "weights": weights});
            Specification::from_json(&document.to_string()).unwrap()
        };
        let specifications: Vec<Specification> = machines.iter().map(specification).collect();
        let sensors: Vec<Vec<Vec<f32>>> = sensed.chunks_exact(16).map(<[Vec<f32>]>::to_vec).collect();
        agree((9, 0), &specifications, &sensors)?;
    }

    #[test]
    fn trees_of_modules_agree_over_many_steps(
        machines in prop::collection::vec(machine_of_modules(), 16),
        sensed in prop::collection::vec(sensed(), 16 * 60),
    ) {
        let specification = |machine: &Vec<f32>| {
            // The first transition of each state.
            let rows = machine[1..].chunks_exact(24).flat_map(|row| row[..9].iter().copied());
            let weights: Vec<f32> = std::iter::once(machine[0]).chain(rows).collect();
            let document = json!({"version": 1, "kind": "modules", "form": "tree", "sensors": 9, "actuators": 2, "states": 4,
                "transitions": 1, "weights": weights});
            Specification::from_json(&document.to_string()).unwrap()
        };
        let specifications: Vec<Specification> = machines.iter().map(specification).collect();
        let sensors: Vec<Vec<Vec<f32>>> = sensed.chunks_exact(16).map(<[Vec<f32>]>::to_vec).collect();
        agree((9, 0), &specifications, &sensors)?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn lanes_agree_with_single_controllers(
        (split, architecture) in prop::sample::select(SENSORS.to_vec())
            .prop_flat_map(|split| (Just(split), architecture(split.0 + split.1))),
        weights in prop::collection::vec(weight(), 2000),
        readings in prop::collection::vec(reading(), 500),
    ) {
        let count = swarmwright_controllers::Architecture::from_json(&architecture.to_string()).unwrap().weight_count();
        let mut drawn = weights.iter().cycle();
        let specifications: Vec<Specification> = (0..16)
            .map(|_| {
                let mut specification = architecture.clone();
                specification["weights"] = json!(drawn.by_ref().take(count).collect::<Vec<_>>());
                Specification::from_json(&specification.to_string()).unwrap()
            })
            .collect();
        let width = specifications[0].architecture().sensors();
        let mut read = readings.iter().cycle();
        let mut reading = || -> Vec<f32> {
            let mut sensors: Vec<f32> = read.by_ref().take(width).copied().collect();
            for bit in &mut sensors[split.0..] {
                *bit = f32::from(u8::from(*bit > 0.0));
            }
            sensors
        };
        let sensors: Vec<Vec<Vec<f32>>> = (0..4).map(|_| (0..16).map(|_| reading()).collect()).collect();
        agree(split, &specifications, &sensors)?;
    }
}
