//! A schedule from a seed.

use crate::random::{Random, mix};
use crate::schedule::{
    BROKER_PATIENCE, Disturbance, FOR_GOOD, Kind, MILLI, Memory, SECOND, Schedule, Server, Time,
    Tool, Twin, What, Who, Work,
};

/// Steps of an episode, about.
const STEPS: u64 = 4;

/// How late a message may be that others on other topics have overtaken.
const MOST_CROSSED: Time = 200 * MILLI;

/// The schedule of a seed.
#[must_use]
pub fn draw(seed: u64) -> Schedule {
    let mut random = Random::new(seed);
    let tools = match random.below(10) {
        0 => 3,
        1 | 2 => 2,
        _ => 1,
    };
    let plain = random.chance(15);
    let tools: Vec<Tool> = (0..tools).map(|_| tool(plain, &mut random)).collect();
    let servers = random.magnitude(1, 9);
    let pace = random.magnitude(50, 30 * MILLI);
    let servers: Vec<Server> = (0..servers)
        .map(|_| Server {
            joins: 0,
            pace: pace * random.magnitude(1, 11),
            patience: [5, 20, 60][random.index(3)] * SECOND,
            plain: plain && random.chance(60),
            twin: None,
        })
        .collect();
    let mut schedule = Schedule {
        seed,
        tools,
        servers,
        disturbances: Vec::new(),
    };
    let length = length(&schedule);
    for tool in &mut schedule.tools {
        tool.joins = random.below(length / 4 + MILLI);
    }
    for server in &mut schedule.servers {
        if random.chance(20) {
            server.joins = random.magnitude(MILLI, length + SECOND);
        }
    }
    // One in ten goes without any disturbance.
    let count = random.below(10);
    for _ in 0..count {
        let disturbance = disturbance(&schedule, length, &mut random);
        schedule.disturbances.push(disturbance);
    }
    // Numbers of its own, so that the rest stays what it is for a seed.
    let mut random = Random::new(mix(&[seed, 2]));
    if random.chance(15) {
        takeovers(&mut schedule, length, &mut random);
    }
    let mut random = Random::new(mix(&[seed, 3]));
    if random.chance(8) {
        broken(&mut schedule, length, &mut random);
    }
    if random.chance(6) {
        storm(&mut schedule, length, &mut random);
    }
    schedule
}

/// A server is away for so long that the broker gives it up, and another one gets its id meanwhile.
fn takeovers(schedule: &mut Schedule, length: Time, random: &mut Random) {
    let server = random.index(schedule.servers.len());
    let others = schedule.servers.len() > 1;
    if schedule.servers[server].plain {
        return;
    }
    let joins = schedule.servers[server].joins;
    let at = joins + random.below(length + length / 4);
    let party = Who::Server(server);
    let away = random.magnitude(BROKER_PATIENCE / 2, 3 * BROKER_PATIENCE);
    let (event, lasts) = [
        (What::Freeze(party), away),
        (What::Partition(party), away),
        (What::Cut(party), 0),
    ][random.index(3)];
    schedule.disturbances.push(Disturbance {
        at,
        lasts,
        what: event,
    });
    let twin = Server {
        joins: at + random.magnitude(MILLI, 2 * BROKER_PATIENCE),
        twin: Some(Twin {
            id: server as u64 + 1,
            // A server must be left that offers what the tools need.
            foreign: others && random.chance(50),
        }),
        ..schedule.servers[server].clone()
    };
    schedule.servers.push(twin);
}

/// Some installations are broken, from the start or after a while, or all of them are.
fn broken(schedule: &mut Schedule, length: Time, random: &mut Random) {
    let all = random.chance(15);
    for server in 0..schedule.servers.len() {
        if all || random.chance(50) {
            let at = if random.chance(50) {
                0
            } else {
                random.below(length)
            };
            let lasts = if random.chance(30) {
                random.magnitude(10 * MILLI, 30 * SECOND)
            } else {
                FOR_GOOD
            };
            let event = What::Break(server);
            schedule.disturbances.push(Disturbance {
                at,
                lasts,
                what: event,
            });
        }
    }
}

/// All servers die, or are stopped, at the same time, again and again.
fn storm(schedule: &mut Schedule, length: Time, random: &mut Random) {
    let dies = random.chance(50);
    let lasts = random.magnitude(100 * MILLI, 8 * SECOND);
    let pause = random.magnitude(10 * MILLI, 4 * SECOND);
    let mut at = random.below(length);
    for _ in 0..random.between(3, 8) {
        for server in 0..schedule.servers.len() {
            let event = if dies {
                What::Crash {
                    server,
                    power: false,
                }
            } else {
                What::Freeze(Who::Server(server))
            };
            schedule.disturbances.push(Disturbance {
                at,
                lasts,
                what: event,
            });
        }
        at += lasts + pause;
    }
}

fn tool(plain: bool, random: &mut Random) -> Tool {
    let modes = ["auto", "stepwise", "offloaded", "batched"];
    let mode = modes[random.index(if plain { 2 } else { 4 })];
    Tool {
        joins: 0,
        mode: mode.to_owned(),
        attempts: u32::try_from(random.between(2, 4)).unwrap_or(3),
        step_timeout: [2, 5, 10][random.index(3)] * SECOND,
        works: (0..random.between(1, 3))
            .map(|_| work(mode == "stepwise" || plain, random))
            .collect(),
    }
}

fn work(small: bool, random: &mut Random) -> Work {
    let most = if small { 8 } else { 40 };
    let candidates = usize::try_from(random.magnitude(1, most)).unwrap_or(1);
    let sample = |percent, random: &mut Random| {
        let hit = random.chance(percent);
        if hit {
            vec![random.index(candidates)]
        } else {
            Vec::new()
        }
    };
    let failing = sample(12, random);
    let mut deadly = sample(8, random);
    deadly.retain(|candidate| !failing.contains(candidate));
    Work {
        kind: [
            Kind::Layered,
            Kind::FullyMeshed,
            Kind::FullyMeshed,
            Kind::ParameterSet,
        ][random.index(4)],
        candidates,
        episodes: random.index(3) + 1,
        window: random.chance(35).then(|| 1 + random.index(candidates)),
        failing,
        deadly,
        pause: if random.chance(15) {
            random.magnitude(MILLI, 12 * SECOND)
        } else {
            random.below(2 * MILLI)
        },
    }
}

/// How long all work takes, about.
fn length(schedule: &Schedule) -> Time {
    let evaluations: usize = schedule
        .tools
        .iter()
        .flat_map(|tool| &tool.works)
        .map(|work| work.candidates * work.episodes)
        .sum();
    let speed: f64 = schedule
        .servers
        .iter()
        .map(|server| {
            #[expect(clippy::cast_precision_loss, reason = "an estimate")]
            let seconds = (server.pace * STEPS + 5 * MILLI) as f64;
            1.0 / seconds
        })
        .sum();
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "an estimate"
    )]
    let time = (evaluations as f64 / speed) as Time;
    time + 100 * MILLI
}

fn disturbance(schedule: &Schedule, length: Time, random: &mut Random) -> Disturbance {
    let server = random.index(schedule.servers.len());
    let tool = random.index(schedule.tools.len());
    let party = if random.chance(70) {
        Who::Server(server)
    } else {
        Who::Tool(tool)
    };
    let short = random.magnitude(MILLI, 3 * SECOND);
    let long = random.magnitude(10 * MILLI, 2 * BROKER_PATIENCE);
    let percent = random.magnitude(1, 60);
    let later = random.magnitude(10, SECOND);
    let (event, lasts) = match random.below(24) {
        0 | 1 => (What::Cut(party), 0),
        2 | 3 => (What::Partition(party), long),
        4..=6 => (
            What::Crash {
                server,
                power: random.chance(30),
            },
            long,
        ),
        7 => (What::Leave(server), long),
        8..=10 => (What::Freeze(party), long),
        11 | 12 => {
            let memory = [Memory::Kept, Memory::Stale, Memory::Lost][random.index(3)];
            (What::Broker(memory), random.magnitude(MILLI, 20 * SECOND))
        }
        13 | 14 => (What::Restart(tool), short),
        15 => (What::Interrupt(tool), 0),
        16 => (What::Lose { party, percent }, long),
        17 => (
            What::Duplicate {
                party,
                percent,
                later,
            },
            long,
        ),
        18 => (
            What::Reorder {
                party,
                percent,
                later,
            },
            long,
        ),
        19 => (What::Delay { party, by: later }, long),
        20 | 21 => (
            What::Cross {
                party,
                percent,
                later: later.min(MOST_CROSSED),
            },
            long,
        ),
        _ => (
            What::Slow {
                server,
                times: random.between(2, 10),
            },
            long,
        ),
    };
    Disturbance {
        at: random.below(length + length / 4),
        lasts,
        what: event,
    }
}
