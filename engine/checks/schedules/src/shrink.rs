//! The smallest schedule that still fails: disturbances, servers, tools and candidates are left out one after another.

use crate::schedule::{Disturbance, Schedule, What, Who};
use crate::{Report, check};

/// Simulations that a shrinking may take.
const TRIALS: usize = 600;

/// Returns a smaller schedule that also fails, and its failure.
#[must_use]
pub fn shrink(schedule: &Schedule) -> (Schedule, Report) {
    let mut best = schedule.clone();
    let mut report = check(&best, false);
    let mut trials = 0;
    loop {
        let mut smaller = false;
        let mut index = 0;
        // Candidates for a smaller schedule are made anew after each success; the place goes on.
        while let Some(candidate) = candidates(&best).into_iter().nth(index) {
            trials += 1;
            if trials > TRIALS {
                return (best, report);
            }
            let outcome = check(&candidate, false);
            if outcome.violation.is_some() {
                (best, report, smaller) = (candidate, outcome, true);
            } else {
                index += 1;
            }
        }
        if !smaller {
            return (best, report);
        }
    }
}

/// Schedules with a little less in them, the ones with much less first.
fn candidates(schedule: &Schedule) -> Vec<Schedule> {
    let mut schedules = Vec::new();
    let count = schedule.disturbances.len();
    let mut part = count / 2;
    while part >= 1 {
        for start in (0..count).step_by(part) {
            let mut less = schedule.clone();
            less.disturbances.drain(start..(start + part).min(count));
            schedules.push(less);
        }
        part /= 2;
    }
    schedules.extend(
        (1..schedule.servers.len())
            .rev()
            .map(|server| without_server(schedule, server)),
    );
    schedules.extend(
        (1..schedule.tools.len())
            .rev()
            .map(|tool| without_tool(schedule, tool)),
    );
    if schedule.servers.len() > 1 {
        schedules.push(without_server(schedule, 0));
    }
    // A server must be left that offers what the tools need.
    schedules.retain(|less| less.servers.iter().any(|server| server.twin.is_none()));
    if schedule.tools.len() > 1 {
        schedules.push(without_tool(schedule, 0));
    }
    for tool in 0..schedule.tools.len() {
        for work in 0..schedule.tools[tool].works.len() {
            schedules.extend(smaller_works(schedule, tool, work));
        }
    }
    schedules
}

fn smaller_works(schedule: &Schedule, tool: usize, work: usize) -> Vec<Schedule> {
    let plan = &schedule.tools[tool].works[work];
    let mut schedules = Vec::new();
    let mut change = |changed: bool, change: &dyn Fn(&mut crate::schedule::Work)| {
        if changed {
            let mut less = schedule.clone();
            change(&mut less.tools[tool].works[work]);
            schedules.push(less);
        }
    };
    change(plan.candidates > 1, &|work| {
        limit(work, work.candidates / 2)
    });
    change(plan.candidates > 1, &|work| {
        limit(work, work.candidates - 1)
    });
    change(plan.episodes > 1, &|work| work.episodes = 1);
    change(!plan.failing.is_empty(), &|work| work.failing.clear());
    change(!plan.deadly.is_empty(), &|work| work.deadly.clear());
    change(plan.window.is_some(), &|work| work.window = None);
    change(plan.pause > 0, &|work| work.pause = 0);
    if schedule.tools[tool].works.len() > 1 {
        let mut less = schedule.clone();
        less.tools[tool].works.remove(work);
        schedules.push(less);
    }
    schedules
}

fn limit(work: &mut crate::schedule::Work, candidates: usize) {
    work.candidates = candidates;
    work.failing.retain(|&candidate| candidate < candidates);
    work.deadly.retain(|&candidate| candidate < candidates);
}

fn without_server(schedule: &Schedule, server: usize) -> Schedule {
    let mut less = schedule.clone();
    less.servers.remove(server);
    less.disturbances
        .retain(|disturbance| disturbance.who() != Some(Who::Server(server)));
    let rename = |party: &mut Who| {
        if let Who::Server(index) = party {
            lower(index, server);
        }
    };
    for disturbance in &mut less.disturbances {
        each(disturbance, rename, |index| lower(index, server), |_| ());
    }
    less
}

fn without_tool(schedule: &Schedule, tool: usize) -> Schedule {
    let mut less = schedule.clone();
    less.tools.remove(tool);
    less.disturbances
        .retain(|disturbance| disturbance.who() != Some(Who::Tool(tool)));
    let rename = |party: &mut Who| {
        if let Who::Tool(index) = party {
            lower(index, tool);
        }
    };
    for disturbance in &mut less.disturbances {
        each(disturbance, rename, |_| (), |index| lower(index, tool));
    }
    less
}

fn lower(index: &mut usize, above: usize) {
    if *index > above {
        *index -= 1;
    }
}

/// Changes the parties in a disturbance.
fn each(
    disturbance: &mut Disturbance,
    party: impl Fn(&mut Who),
    server: impl Fn(&mut usize),
    tool: impl Fn(&mut usize),
) {
    match &mut disturbance.what {
        What::Cut(target)
        | What::Partition(target)
        | What::Freeze(target)
        | What::Lose { party: target, .. }
        | What::Duplicate { party: target, .. }
        | What::Reorder { party: target, .. }
        | What::Cross { party: target, .. }
        | What::Delay { party: target, .. } => party(target),
        What::Crash { server: index, .. }
        | What::Leave(index)
        | What::Break(index)
        | What::Slow { server: index, .. } => server(index),
        What::Restart(index) | What::Interrupt(index) => tool(index),
        What::Broker(_) => {}
    }
}
