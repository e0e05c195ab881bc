//! What holds for every episode of Emergency Exit, and what parameters it refuses.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use proptest::prelude::*;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use swarmwright_worlds::{EmergencyExit, ParameterError, Scene, Simulation, TextStyle, render};

fn reset(parameters: &Value) -> Result<EmergencyExit, ParameterError> {
    let mut simulation = EmergencyExit::default();
    simulation.reset(parameters.as_object().unwrap())?;
    Ok(simulation)
}

/// A cell as [x, y], and whether its agent is out.
fn agents(scene: &Scene) -> Vec<([i32; 2], bool)> {
    of_kind(scene, "agent")
        .into_iter()
        .zip(scene.bodies.iter().filter(|b| b.kind == "agent"))
        .map(|(cell, body)| (cell, body.state == "out"))
        .collect()
}

fn of_kind(scene: &Scene, kind: &str) -> Vec<[i32; 2]> {
    let bodies = scene.bodies.iter().filter(|body| body.kind == kind);
    bodies
        .map(|b| [b.x as i32, (scene.height - b.y) as i32])
        .collect()
}

fn field() -> impl Strategy<Value = Value> {
    (1_usize..9, 1_usize..9).prop_flat_map(|(width, height)| {
        let cells: Vec<[usize; 2]> = (0..width * height)
            .map(|i| [i % width, i / width])
            .collect();
        (
            Just(cells).prop_shuffle(),
            any::<[prop::sample::Index; 3]>(),
        )
            .prop_map(move |(cells, [a, b, c])| {
                // Some agents may start on exits.
                let agents = 1 + a.index(cells.len());
                let blockades = b.index(cells.len() - agents + 1);
                let walkable = cells.len() - blockades;
                let exits = 1 + c.index(walkable.min(6));
                json!({
                    "width": width, "height": height, "agents": cells[..agents],
                    "blockades": cells[walkable..], "exits": cells[walkable - exits..walkable],
                })
            })
    })
}

fn episode() -> impl Strategy<Value = Value> {
    let random = (2_u32..12, 2_u32..12, any::<i64>()).prop_map(|(width, height, seed)| {
        json!({"width": width, "height": height, "seed": seed, "numAgents": width.min(3), "numExits": 1,
            "numBlockades": width * width / 3 - 1})
    });
    let with_field = field().prop_map(|field| json!({ "field": field }));
    let update = prop::sample::select(vec!["sequential", "simultaneous"]);
    (prop_oneof![random, with_field], update, 1_u32..12).prop_map(
        |(mut parameters, update, steps)| {
            parameters["update"] = update.into();
            parameters["steps"] = steps.into();
            parameters
        },
    )
}

/// Numbers in -1..=1 that depend on nothing but how many have been asked for.
fn noise(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed | 1;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 40) as f32 / 8_388_608.0 - 1.0
    }
}

proptest! {
    #[test]
    fn walls_cells_and_exits_are_respected(parameters in episode(), seed in any::<u64>()) {
        let mut simulation = reset(&parameters).unwrap();
        let simultaneous = parameters["update"] == "simultaneous";
        let steps = parameters["steps"].as_u64().unwrap();
        let mut noise = noise(seed);
        let first = simulation.scene().unwrap();
        let blockades = of_kind(&first, "blockade");
        let exits = of_kind(&first, "exit");
        let mut before = agents(&first);
        let mut step = 0;
        let mut finished = steps;
        while !simulation.acting().is_empty() {
            let acting = simulation.acting().to_vec();
            prop_assert!(acting.is_sorted() && (simultaneous || acting.len() == 1));
            let free: Vec<u32> = (0..).zip(&before).filter(|(_, a)| !a.1).map(|(i, _)| i).collect();
            let expected = if simultaneous { free.clone() } else { acting.clone() };
            prop_assert_eq!(&acting, &expected);
            prop_assert!(acting.iter().all(|agent| free.contains(agent)));
            let actuators: Vec<f32> = acting.iter().flat_map(|_| [noise(), noise()]).collect();
            simulation.step(&actuators);

            let scene = simulation.scene().unwrap();
            let after = agents(&scene);
            let mut taken = BTreeSet::new();
            for (i, ((old, was_out), (cell, out))) in before.iter().zip(&after).enumerate() {
                let acted = acting.contains(&(i as u32));
                prop_assert!(!was_out || (*out && old == cell), "out for good");
                prop_assert!(acted || old == cell, "only those who act move");
                prop_assert!((old[0] - cell[0]).abs() <= 1 && (old[1] - cell[1]).abs() <= 1);
                prop_assert!(!blockades.contains(cell), "no agent on a blockade");
                prop_assert!((0..scene.width as i32).contains(&cell[0]) && cell[1] >= 0);
                prop_assert!(*out || taken.insert(*cell), "no two agents in a cell");
                prop_assert_eq!(*out, *was_out || (acted && exits.contains(cell)));
            }
            let all_out = after.iter().all(|agent| agent.1);
            if scene.step != step && all_out {
                finished = u64::from(step);
            }
            step = scene.step;
            before = after;
        }
        prop_assert!(u64::from(step) == steps || finished == u64::from(step) - 1);
        let away = |cell: [i32; 2]| {
            let squared = |e: &[i32; 2]| (e[0] - cell[0]).pow(2) + (e[1] - cell[1]).pow(2);
            f64::from(exits.iter().map(squared).min().unwrap()).sqrt()
        };
        let start = (steps - finished) as f64 / steps as f64;
        let expected = before.iter().fold(start, |sum, (cell, _)| sum - away(*cell));
        prop_assert_eq!(simulation.fitness(), expected);
        let distance = before.iter().fold(0.0, |sum, (cell, _)| sum + away(*cell));
        let out = before.iter().filter(|agent| agent.1).count();
        prop_assert_eq!(simulation.metrics(), [out as f64, finished as f64, distance]);
        simulation.step(&[1.0, 1.0]);
        prop_assert_eq!(simulation.fitness(), expected, "an episode that has ended stays as it is");
    }

    #[test]
    fn the_first_of_the_nearest_exits_is_sensed(
        (side, exits) in (4_u32..40).prop_flat_map(|side| (Just(side), prop::collection::vec([0..side, 1..side], 1..side as usize * side as usize))),
        seed in any::<u64>()
    ) {
        let agents: Vec<[u32; 2]> = (0..side).step_by(2).map(|x| [x, 0]).collect();
        let field = json!({"width": side, "height": side, "agents": agents, "exits": exits});
        let mut simulation = reset(&json!({"field": field, "steps": 12})).unwrap();
        let mut noise = noise(seed);
        while let [agent, ..] = *simulation.acting() {
            let ([x, y], _) = self::agents(&simulation.scene().unwrap())[agent as usize];
            let ways = exits.iter().map(|exit| [exit[0] as i32 - x, exit[1] as i32 - y]);
            // min_by_key gives the first of equal ones.
            let nearest = ways.min_by_key(|[dx, dy]| dx * dx + dy * dy).unwrap();
            let mut sensors = [0.0; 10];
            simulation.sense(agent, &mut sensors);
            prop_assert_eq!([sensors[0], sensors[1]], nearest.map(|cells| cells as f32));
            simulation.step(&[noise(), noise()]);
        }
    }

    #[test]
    fn an_episode_begins_anew_whatever_was_before(
        parameters in episode(), other in episode(), seed in any::<u64>()
    ) {
        let run = |simulation: &mut EmergencyExit| {
            let mut noise = noise(seed);
            let mut seen = Vec::new();
            while !simulation.acting().is_empty() {
                let mut sensors = [0.0; 10];
                simulation.sense(simulation.acting()[0], &mut sensors);
                let count = simulation.acting().len();
                let actuators: Vec<f32> = (0..2 * count).map(|_| noise()).collect();
                simulation.step(&actuators);
                seen.push((sensors.map(f32::to_bits), simulation.fitness().to_bits()));
            }
            seen
        };
        let mut simulation = reset(&parameters).unwrap();
        let seen = run(&mut simulation);
        for parameters in [&parameters, &other, &parameters] {
            simulation.reset(parameters.as_object().unwrap()).unwrap();
            let again = run(&mut simulation);
            prop_assert!(parameters == &other || again == seen);
        }
    }

    #[test]
    fn sensors_tell_where_a_move_leads(parameters in episode(), seed in any::<u64>()) {
        let mut simulation = reset(&parameters).unwrap();
        let mut noise = noise(seed);
        let moves = [[0, -1], [1, -1], [1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1]];
        while !simulation.acting().is_empty() {
            let actuators: Vec<f32> = simulation.acting().iter().flat_map(|_| [noise(), noise()]).collect();
            if parameters["update"] == "sequential" {
                // One agent at a time: what it senses is what there is when it moves.
                let agent = simulation.acting()[0];
                let mut sensors = [0.0; 10];
                simulation.sense(agent, &mut sensors);
                let before = agents(&simulation.scene().unwrap())[agent as usize].0;
                let wanted = [actuators[0], actuators[1]].map(|a| (a + 0.5).floor() as i32);
                simulation.step(&actuators);
                let after = agents(&simulation.scene().unwrap())[agent as usize].0;
                let free = moves.iter().position(|m| *m == wanted).is_some_and(|d| sensors[2 + d] == 1.0);
                let expected = if free { [before[0] + wanted[0], before[1] + wanted[1]] } else { before };
                prop_assert_eq!(after, expected);
            } else {
                simulation.step(&actuators);
            }
        }
    }
}

#[test]
fn of_two_that_want_one_cell_the_lower_index_gets_it() {
    let field = json!({"width": 3, "height": 2, "agents": [[2, 0], [0, 0], [1, 1]], "exits": [[0, 1]], "blockades": []});
    let parameters = json!({"field": field, "update": "simultaneous"});
    let mut simulation = reset(&parameters).unwrap();
    // Agents 0 and 1 want [1, 0]; agent 2 leaves [1, 1], which agent 1 could take only in a later step.
    simulation.step(&[-1.0, 0.0, 1.0, 0.0, -1.0, 0.0]);
    let now = agents(&simulation.scene().unwrap());
    assert_eq!(now, [([1, 0], false), ([0, 0], false), ([0, 1], true)]);

    simulation.reset(parameters.as_object().unwrap()).unwrap();
    simulation.step(&[0.0, 0.0, 1.0, 1.0, -1.0, 0.0]);
    let now = agents(&simulation.scene().unwrap());
    assert_eq!(
        now[1],
        ([0, 0], false),
        "the cell was taken when all sensed"
    );
    simulation.step(&[0.0, 0.0, 1.0, 1.0]);
    assert_eq!(agents(&simulation.scene().unwrap())[1], ([1, 1], false));
}

#[test]
fn half_a_cell_is_a_move_upwards_only() {
    let field =
        json!({"width": 5, "height": 5, "agents": [[2, 2]], "exits": [[0, 0]], "blockades": []});
    let parameters = json!({"field": field, "steps": 1});
    for (a, moved) in [
        (0.5, 1),
        (0.499_999_97, 0),
        (-0.5, 0),
        (-0.500_000_06, -1),
        (1.0, 1),
        (-1.0, -1),
    ] {
        let mut simulation = reset(&parameters).unwrap();
        simulation.step(&[a, 0.0]);
        assert_eq!(
            agents(&simulation.scene().unwrap())[0].0,
            [2 + moved, 2],
            "{a}"
        );
    }
}

#[test]
fn wrong_parameters_are_named_with_a_way_out() {
    let good = json!({"width": 4, "height": 3, "agents": [[0, 0], [1, 0]], "exits": [[3, 2]], "blockades": [[2, 2]]});
    let with = |key: &str, value: Value| {
        let mut field = good.clone();
        field[key] = value;
        json!({ "field": field })
    };
    assert!(reset(&json!({"field": good, "width": 4, "numAgents": 2, "numBlockades": 1})).is_ok());
    let without_exits = json!({"field": {"width": 4, "height": 3, "agents": [[0, 0]]}});
    let without_height = json!({"field": {"width": 4}});
    for (parameters, answer) in [
        (
            json!({"steps": 0}),
            "steps: 0 found, expected a whole number from 1",
        ),
        (json!({"width": "20"}), "width: \"20\" (a string) found"),
        (
            json!({"update": "parallel"}),
            "one of \"sequential\", \"simultaneous\"",
        ),
        (json!({"numExits": 0}), "numExits: 0 found"),
        (
            json!({"numAgents": 21}),
            "at most 20 agents, the larger of width and height",
        ),
        (
            json!({"numBlockades": 386}),
            "need 401 cells, and a random field has width x width = 400",
        ),
        (
            json!({"height": 30, "numAgents": 30, "numBlockades": 366}),
            "need 401 cells",
        ),
        (
            json!({"field": "stadium.json"}),
            "field: \"stadium.json\" found, but the simulation reads no files",
        ),
        (json!({"field": [1]}), "field: expected an object"),
        (without_height, "field.height: is missing"),
        (without_exits, "field.exits: at least one cell"),
        (with("agents", json!([])), "field.agents: at least one cell"),
        (
            with("walls", json!([])),
            "field: unknown key \"walls\"; known keys: width, height, agents",
        ),
        (
            with("width", json!(2001)),
            "field.width: 2001 found, expected a whole number from 1 to 2000",
        ),
        (
            with("agents", json!([[4, 0]])),
            "field.agents[0]: [4,0] found, expected a position inside",
        ),
        (
            with("agents", json!([[0, 0.5]])),
            "field.agents[0]: [0, 0.5] found, expected column and row",
        ),
        (
            with("agents", json!([[0, 0], [1, 1], [0, 0]])),
            "field.agents[2]: [0, 0] found, where another agent",
        ),
        (
            with("agents", json!([[2, 2]])),
            "field.agents[0]: [2, 2] found, where a blockade stands",
        ),
        (
            with("exits", json!([[2, 2]])),
            "field.exits[0]: [2, 2] found, where a blockade stands",
        ),
        (
            json!({"field": good, "width": 5}),
            "width: 5 found, but the field has 4; make them agree or leave width out",
        ),
        (
            json!({"field": good, "numAgents": 10}),
            "numAgents: 10 found, but the field has 2",
        ),
    ] {
        let found = reset(&parameters).unwrap_err().to_string();
        assert!(found.contains(answer), "{parameters}:\n{found}\n{answer}");
    }
}

#[test]
fn cells_walls_exits_and_agents_are_drawn() {
    let field = json!({"width": 4, "height": 3, "agents": [[0, 0], [2, 2]], "exits": [[3, 2]], "blockades": [[0, 2], [1, 1]]});
    let mut simulation = reset(&json!({"field": field, "update": "simultaneous"})).unwrap();
    simulation.step(&[0.0, 0.0, 1.0, 0.0]);
    let style = TextStyle {
        columns: 10,
        rows: 7,
        unicode: false,
        color: false,
    };
    let lines = render(&simulation.scene().unwrap(), style);
    // Two characters a cell; y points down; the agent at the exit is out.
    assert_eq!(
        lines[1..],
        [
            "+--------+",
            "| o      |",
            "|  ##    |",
            "|##    E*|",
            "+--------+",
            "o free 1"
        ]
    );
    let style = TextStyle {
        columns: 40,
        ..style
    };
    let legend = render(&simulation.scene().unwrap(), style).pop().unwrap();
    assert_eq!(legend, "o free 1   * out 1   E exit 1");
}
