//! Generators of messages of every kind, as a program may create them.

use std::collections::BTreeMap;

use proptest::prelude::*;
use serde_json::{Map, Value, json};
use swarmwright_protocol::{
    Actuator, BatchActuators, BatchSensors, BatchStart, Capabilities, Control, Discovery, Evaluate,
    Evaluated, F32s, F64s, Failed, Failure, Fitness, Message, ParametersMessage, Presence, Refusal,
    RefusalKind, Requirements, Sample, Sensor, ServerMessage, State, ToServer, ToTool, Topic, U32s,
    U64s,
};

fn text() -> impl Strategy<Value = String> {
    prop_oneof![".{0,12}", "[a-z]{1,8}"]
}

fn real() -> impl Strategy<Value = f64> {
    use prop::num::f64;
    prop_oneof![
        f64::NORMAL | f64::ZERO | f64::SUBNORMAL,
        (-9i32..9).prop_map(f64::from)
    ]
}

fn single() -> impl Strategy<Value = f32> {
    use prop::num::f32;
    f32::NORMAL | f32::ZERO | f32::SUBNORMAL
}

fn id() -> impl Strategy<Value = u64> {
    prop_oneof![0..9u64, 0..=i64::MAX.unsigned_abs()]
}

/// Generates JSON below the keys of parameters.
fn value() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        real().prop_map(Value::from),
        text().prop_map(Value::from),
    ];
    leaf.prop_recursive(3, 12, 4, |inner| {
        let object = prop::collection::btree_map(text(), inner.clone(), 0..4);
        prop_oneof![
            prop::collection::vec(inner, 0..4).prop_map(Value::from),
            object.prop_map(|fields| Value::Object(fields.into_iter().collect())),
        ]
    })
}

fn object() -> impl Strategy<Value = Map<String, Value>> {
    let fields = prop::collection::btree_map(text(), value(), 0..5);
    fields.prop_map(|fields| {
        let own = |key: &String| key != "server" && key != "simulation_hash";
        fields.into_iter().filter(|(key, _)| own(key)).collect()
    })
}

fn capabilities() -> impl Strategy<Value = Capabilities> {
    (real(), prop::option::of(real()), prop::option::of(text())).prop_map(|(dimensions, max_agents, host)| {
        let announced = host.map(|host| json!({"version": 1, "modes": ["stepwise"], "host": host}));
        let mut object = json!({"dimensions": dimensions, "max_agents": max_agents, "swarmwright": announced});
        object.as_object_mut().unwrap().retain(|_, value| !value.is_null());
        let message = json!({"server": 1, "simulation_hash": "", "simulations": [""], "capabilities": object});
        match Message::decode(Topic::Server, message.to_string().as_bytes()) {
            Ok(Message::Server(message)) => message.capabilities,
            other => panic!("{other:?}"),
        }
    })
}

fn conversation() -> impl Strategy<Value = Message> {
    let optional = || prop::option::of(text());
    let readings = || prop::collection::vec(single(), 1..9);
    prop_oneof![
        (text(), text(), real(), prop::option::of(real()), optional()).prop_map(
            |(simulation, simulation_hash, dimensions, max_agents, tool)| {
                let requirements = Requirements {
                    dimensions,
                    max_agents,
                };
                Message::Discovery(Discovery {
                    simulation,
                    simulation_hash,
                    requirements,
                    tool,
                })
            }
        ),
        (
            id(),
            text(),
            prop::collection::vec(text(), 1..3),
            capabilities()
        )
            .prop_map(|(server, simulation_hash, simulations, capabilities)| {
                Message::Server(ServerMessage {
                    server,
                    simulation_hash,
                    simulations,
                    capabilities,
                })
            }),
        (id(), text(), object()).prop_map(|(server, simulation_hash, parameters)| {
            Message::Parameters(ParametersMessage {
                server,
                simulation_hash,
                parameters,
            })
        }),
        (
            id(),
            optional(),
            text(),
            any::<(bool, bool)>(),
            optional(),
            optional(),
            optional(),
            proptest::option::of(proptest::collection::vec(text(), 0..3))
        )
            .prop_map(
                |(
                    server,
                    simulation,
                    simulation_hash,
                    (run, visual),
                    tool,
                    reply,
                    instance,
                    scenes,
                )| {
                    Message::Control(Control {
                        server,
                        simulation,
                        simulation_hash,
                        run,
                        visual,
                        tool,
                        reply,
                        instance,
                        scenes,
                    })
                }
            ),
        (optional(), text(), id(), readings()).prop_map(
            |(simulation, simulation_hash, agent, sensor)| {
                Message::Sensor(Sensor {
                    simulation,
                    simulation_hash,
                    agent,
                    sensor,
                })
            }
        ),
        (optional(), text(), id(), readings()).prop_map(
            |(simulation, simulation_hash, agent, actuator)| {
                Message::Actuator(Actuator {
                    simulation,
                    simulation_hash,
                    agent,
                    actuator,
                })
            }
        ),
        (
            optional(),
            text(),
            real(),
            prop::collection::btree_map(text(), real(), 0..3)
        )
            .prop_map(|(simulation, simulation_hash, fitness, metrics)| {
                Message::Fitness(Fitness {
                    simulation,
                    simulation_hash,
                    fitness,
                    metrics,
                })
            }),
        (
            id(),
            0..3u8,
            prop::collection::vec(text(), 0..3),
            capabilities(),
            optional(),
            text()
        )
            .prop_map(|(server, state, simulations, capabilities, tool, since)| {
                let state = [State::Ready, State::Busy, State::Lost][usize::from(state)];
                Message::Presence(Presence {
                    server,
                    state,
                    simulations,
                    capabilities,
                    tool,
                    since,
                })
            }),
    ]
}

fn sample() -> impl Strategy<Value = Sample> {
    let row = |genes| prop::collection::vec(real(), genes).prop_map(F64s);
    let limit = |genes| prop::collection::vec(-1e30..1e30, genes).prop_map(F64s);
    let numbers = || {
        (
            any::<u64>(),
            text(),
            any::<u64>(),
            any::<u32>(),
            0..1000_u64,
        )
    };
    (1..6_usize).prop_flat_map(move |genes| {
        (
            numbers(),
            any::<bool>(),
            (row(genes), row(genes), row(genes), row(genes)),
            (limit(genes), limit(genes)),
            text(),
        )
            .prop_map(
                |(
                    (seed, purpose, generation, first, count),
                    mirrored,
                    (center, deviation, middle, reach),
                    (lower, upper),
                    distribution,
                )| Sample {
                    distribution,
                    seed,
                    purpose,
                    generation,
                    first: first.into(),
                    count,
                    mirrored,
                    center,
                    deviation,
                    middle,
                    reach,
                    lower,
                    upper,
                },
            )
    })
}

fn block() -> impl Strategy<Value = Message> {
    let singles = || prop::collection::vec(single(), 0..9).prop_map(F32s);
    let seeds = || prop::collection::vec(any::<u64>(), 1..5).prop_map(U64s);
    let names = || prop::collection::vec(text(), 0..3);
    let ids = || (any::<u64>(), text(), text(), text());
    prop_oneof![
        (
            ids(),
            object(),
            object(),
            singles(),
            seeds(),
            names(),
            any::<u32>(),
            real()
        )
            .prop_flat_map(|all| {
                (
                    Just(all),
                    prop::option::of(text()),
                    prop::option::of(sample()),
                )
            })
            .prop_map(
                |(
                    (
                        (request, tool, reply, simulation),
                        parameters,
                        controller,
                        genomes,
                        seeds,
                        metrics,
                        attempt,
                        lease,
                    ),
                    instance,
                    sample,
                )| {
                    let genomes = if sample.is_some() {
                        F32s::default()
                    } else {
                        genomes
                    };
                    Message::ToServer(ToServer::Evaluate(Evaluate {
                        version: 1,
                        request,
                        tool,
                        reply,
                        simulation,
                        parameters,
                        controller,
                        genomes,
                        seeds,
                        metrics,
                        attempt,
                        lease,
                        instance,
                        sample: sample.map(Box::new),
                    }))
                }
            ),
        (ids(), object(), seeds(), names(), prop::option::of(text())).prop_map(
            |((request, tool, reply, simulation), parameters, seeds, metrics, instance)| {
                Message::ToServer(ToServer::Start(BatchStart {
                    version: 1,
                    request,
                    tool,
                    reply,
                    simulation,
                    parameters,
                    seeds,
                    metrics,
                    instance,
                }))
            }
        ),
        (any::<u64>(), any::<u64>(), singles()).prop_map(|(request, step, actuators)| {
            Message::ToServer(ToServer::Actuators(BatchActuators {
                version: 1,
                request,
                step,
                actuators,
            }))
        }),
    ]
}

fn refusal() -> impl Strategy<Value = Option<Refusal>> {
    prop::option::of((0..3u8, text()).prop_map(|(kind, reason)| Refusal {
        kind: [
            RefusalKind::Taken,
            RefusalKind::Invalid,
            RefusalKind::Failed,
        ][usize::from(kind)],
        reason,
    }))
}

/// Returns one metric, if it has a name.
fn named(name: Option<String>, values: &[f64]) -> BTreeMap<String, F64s> {
    let values = F64s(values.to_vec());
    name.map(|name| (name, values)).into_iter().collect()
}

fn answer() -> impl Strategy<Value = Message> {
    let stack = || prop::option::of(text());
    let failure = (any::<u64>(), any::<u64>(), text(), stack()).prop_map(
        |(candidate, episode, reason, stack)| Failure {
            candidate,
            episode,
            reason,
            stack,
        },
    );
    let failed = prop::collection::vec(failure, 0..3);
    let rows = prop::collection::vec((any::<u32>(), any::<u32>(), single()), 0..6);
    let ended = prop::collection::vec((any::<u32>(), real()), 0..4);
    let numbers = (any::<u64>(), any::<u64>(), any::<u64>());
    prop_oneof![
        (
            numbers,
            prop::collection::vec(real(), 0..6),
            stack(),
            refusal(),
            real()
        )
            .prop_map(
                move |((request, server, _), fitness, name, error, seconds): (
                    _,
                    Vec<f64>,
                    _,
                    _,
                    _
                )| {
                    Message::ToTool(ToTool::Evaluated(Evaluated {
                        version: 1,
                        request,
                        server,
                        metrics: named(name, &fitness[..]),
                        fitness: F64s(fitness),
                        failed: Vec::new(),
                        error,
                        seconds,
                    }))
                }
            ),
        (numbers, rows, ended, stack(), failed, refusal()).prop_map(
            move |((request, server, step), rows, ended, name, failed, error)| {
                let fitness: Vec<f64> = ended.iter().map(|(_, fitness)| *fitness).collect();
                Message::ToTool(ToTool::Sensors(BatchSensors {
                    version: 1,
                    request,
                    server,
                    step,
                    episodes: U32s(rows.iter().map(|row| row.0).collect()),
                    agents: U32s(rows.iter().map(|row| row.1).collect()),
                    sensors: F32s(rows.iter().map(|row| row.2).collect()),
                    ended: U32s(ended.iter().map(|(episode, _)| *episode).collect()),
                    metrics: named(name, &fitness[..]),
                    fitness: F64s(fitness),
                    failed,
                    error,
                }))
            }
        ),
        (any::<u64>(), text(), text(), stack(), any::<bool>()).prop_map(
            |(server, simulation_hash, reason, stack, invalid)| {
                Message::ToTool(ToTool::Failed(Failed {
                    version: 1,
                    server,
                    simulation_hash,
                    reason,
                    stack,
                    invalid,
                }))
            }
        ),
    ]
}

pub fn message() -> impl Strategy<Value = Message> {
    prop_oneof![conversation(), block(), answer()]
}
