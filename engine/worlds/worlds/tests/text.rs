//! Scenes as text: size, symbols, colour.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use proptest::prelude::*;
use serde_json::json;
use swarmwright_worlds::{
    Body, Light, Minisim, Patch, Scene, Simulation, Style, TextStyle, Wall, render,
};

fn example() -> Scene {
    Minisim::default().scene().unwrap()
}

/// Without ANSI colours.
fn bare(line: &str) -> String {
    let mut parts = line.split('\x1b');
    let first = parts.next().unwrap().to_owned();
    parts.fold(first, |text, part| text + part.split_once('m').unwrap().1)
}

/// The row and the column, from 0, inside the border.
fn find(lines: &[String], symbol: char) -> (usize, usize) {
    let map = &lines[2..lines.len() - 2];
    let hit =
        |(row, line): (usize, &String)| Some((row, line.chars().position(|c| c == symbol)? - 1));
    map.iter()
        .enumerate()
        .find_map(hit)
        .unwrap_or_else(|| panic!("no {symbol} in {lines:#?}"))
}

#[test]
fn the_published_example() {
    let lines = render(&example(), TextStyle::default());
    assert_eq!(lines.len(), 24);
    assert!(
        lines[0].starts_with("Welcome to minisim") && lines[0].ends_with("step 0"),
        "{}",
        lines[0]
    );
    assert_eq!(lines[1], format!("┌{}┐", "─".repeat(74)));
    assert_eq!(lines[22], format!("└{}┘", "─".repeat(74)));
    assert_eq!(lines[23], "● free 1   ▲ defender 1   ★ goal");
    let (agent, defender, goal) = (find(&lines, '●'), find(&lines, '▲'), find(&lines, '★'));
    assert_eq!((agent, defender, goal), ((10, 2), (10, 45), (10, 71)));
}

#[test]
fn y_points_up() {
    let mut simulation = Minisim::default();
    simulation
        .reset(
            json!({"agents": [[0, 7]], "defenders": [[13, 0]]})
                .as_object()
                .unwrap(),
        )
        .unwrap();
    let lines = render(
        &simulation.scene().unwrap(),
        TextStyle {
            unicode: false,
            ..TextStyle::default()
        },
    );
    assert!(lines.iter().all(|line| line.is_ascii()));
    assert_eq!(find(&lines, 'o'), (0, 0));
    assert_eq!(find(&lines, 'D'), (19, 73));
}

#[test]
fn colour_changes_nothing_but_colour() {
    let style = TextStyle::default();
    let plain = render(&example(), style);
    let painted = render(
        &example(),
        TextStyle {
            color: true,
            ..style
        },
    );
    assert_ne!(plain, painted);
    assert_eq!(
        painted.iter().map(|line| bare(line)).collect::<Vec<_>>(),
        plain
    );
}

#[test]
fn a_message_cannot_steer_the_terminal() {
    let scene = Scene {
        message: "\x1b[2J\nhi\u{9b}".to_owned(),
        ..example()
    };
    let lines = render(&scene, TextStyle::default());
    assert!(
        lines
            .iter()
            .all(|line| line.chars().all(|c| !c.is_control())),
        "{}",
        lines[0]
    );
}

#[test]
fn states_have_symbols_of_their_own() {
    let body = |state: &'static str, x| Body {
        kind: "agent".into(),
        x,
        y: 3.0,
        state: state.into(),
        radius: 0.0,
        ..Body::default()
    };
    let bodies = vec![body("free", 1.0), body("arrived", 3.0), body("caught", 5.0)];
    let lines = render(
        &Scene {
            bodies,
            ..example()
        },
        TextStyle::default(),
    );
    assert_eq!(lines[23], "● free 1   ● arrived 1   ✗ caught 1");
    let row = lines.iter().find(|line| line.contains('✗')).unwrap();
    assert_eq!(row.replace([' ', '│'], ""), "●●✗");
}

#[test]
fn kinds_and_states_without_a_look_of_their_own_get_one() {
    let body = |kind: &'static str, state: &'static str, x| Body {
        kind: kind.into(),
        x,
        y: 3.0,
        state: state.into(),
        radius: 0.0,
        ..Body::default()
    };
    let bodies = vec![
        body("door", "open", 1.0),
        body("door", "shut", 2.0),
        body("base", "", 3.0),
        body("agent", "carrying", 4.0),
        body("agent", "free", 5.0),
    ];
    let scene = Scene {
        bodies,
        ..example()
    };
    let drawn = |color, unicode| {
        render(
            &scene,
            TextStyle {
                color,
                unicode,
                ..TextStyle::default()
            },
        )
    };
    assert_eq!(
        drawn(false, true)[23],
        "● free 1   ◆ door, open 1   ◆ door, shut 1   ⬟ base 1   ● carrying 1"
    );
    assert_eq!(
        drawn(false, false)[23],
        "o free 1   ? door, open 1   ? door, shut 1   & base 1   o carrying 1"
    );
    let legend = drawn(true, true)[23].clone();
    let colors: Vec<&str> = legend
        .split("\x1b[")
        .filter_map(|part| part.split_once('m').map(|(code, _)| code))
        .filter(|code| *code != "0")
        .collect();
    let mut different = colors.clone();
    different.sort_unstable();
    different.dedup();
    assert_eq!((colors.len(), different.len()), (5, 5), "{legend:?}");
}

proptest! {
    #[test]
    fn never_wider_or_higher_than_asked(
        columns in 0..140_usize,
        rows in 0..60_usize,
        extent in prop::array::uniform2(1..2000_u32),
        agents in 1..9_u32,
        message in ".{0,200}",
    ) {
        let mut simulation = Minisim::default();
        let document = json!({"mapWidth": extent[0], "mapHeight": extent[1], "numAgents": agents,
            "placement": "random", "helloMessage": message});
        simulation.reset(document.as_object().unwrap()).unwrap();
        let lines = render(&simulation.scene().unwrap(), TextStyle { columns, rows, color: false, unicode: true });
        prop_assert!(lines.len() <= rows.max(2), "{} lines", lines.len());
        for line in &lines {
            prop_assert!(line.chars().count() <= columns, "{} characters: {line}", line.chars().count());
        }
        if columns >= 10 && rows >= 10 {
            prop_assert!(lines.iter().any(|line| line.contains('┌')), "a map is drawn");
        }
    }
}

#[test]
fn headings_walls_floor_and_lights_are_drawn() {
    let headings = [0.0, 1.0, -1.0, 0.5].map(|half_turns| half_turns * std::f32::consts::PI);
    let bodies = (1_u16..).zip(headings).map(|(x, heading)| Body {
        kind: "agent".into(),
        x: 2.0 * f32::from(x),
        y: 5.0,
        heading: Some(heading),
        ..Body::default()
    });
    let square = |x: f32, y: f32, side: f32| {
        vec![[x, y], [x + side, y], [x + side, y + side], [x, y + side]]
    };
    let scene = Scene {
        width: 10.0,
        height: 10.0,
        bodies: bodies.collect(),
        floor: Some(Patch {
            grey: 1.0,
            ..Patch::default()
        }),
        patches: vec![
            Patch {
                points: vec![[7.5, 7.5]],
                radius: 2.0,
                ..Patch::default()
            },
            Patch {
                points: square(0.0, 0.0, 3.0),
                grey: 0.5,
                ..Patch::default()
            },
        ],
        walls: vec![
            Wall {
                points: square(5.0, 1.0, 2.0),
                solid: true,
            },
            Wall {
                points: vec![[0.0, 9.9], [10.0, 9.9]],
                solid: false,
            },
        ],
        lights: vec![Light {
            x: 7.5,
            y: 7.5,
            intensity: 1.0,
        }],
        ..Scene::default()
    };
    let style = TextStyle {
        columns: 42,
        ..TextStyle::default()
    };
    let lines = render(&scene, style);
    let map: Vec<Vec<char>> = lines[2..lines.len() - 2]
        .iter()
        .map(|line| line.chars().skip(1).take(40).collect())
        .collect();
    assert_eq!((map.len(), map[0].len()), (20, 40));
    assert_eq!(map[0], ['█'; 40], "a wall along the upper edge");
    assert_eq!(map[19][0], ' ', "grey floor at the lower left");
    assert_eq!(map[10][39], '·', "white floor elsewhere");
    assert_eq!((map[5][30], map[5][24]), ('☼', '░'), "a light above black");
    assert_eq!(
        (map[15][24], map[12][24]),
        ('█', '·'),
        "a solid block, and above it"
    );
    let arrows: String = [8, 16, 24, 32]
        .map(|column| map[10][column])
        .iter()
        .collect();
    assert_eq!(arrows, "→←←↑");
    assert_eq!(lines[23], "● agent 4   ░ black floor   · white floor");
    let plain = render(
        &scene,
        TextStyle {
            unicode: false,
            columns: 80,
            ..style
        },
    );
    assert!(plain.iter().all(|line| line.is_ascii()), "{plain:#?}");
    assert_eq!(
        plain[23],
        "o agent 4   : black floor   . white floor   # wall   * light"
    );
}

#[test]
fn leds_that_are_on_lie_on_robots_and_walls_are_not_arrows() {
    let body = |kind: &'static str, state: &'static str, x, heading| Body {
        kind: kind.into(),
        state: state.into(),
        x,
        y: 2.0,
        radius: 0.05,
        heading,
        ..Body::default()
    };
    let scene = Scene {
        width: 4.0,
        height: 4.0,
        bodies: vec![
            body("agent", "", 1.0, Some(0.0)),
            body("agent", "", 3.0, Some(0.0)),
            body("wall", "blue", 2.0, Some(0.0)),
            body("led", "red", 1.0, None),
            body("led", "", 3.0, None),
        ],
        ..Scene::default()
    };
    let lines = render(&scene, TextStyle::default());
    assert_eq!(
        lines.last().unwrap(),
        "● agent 2   ◆ wall, blue   ⬟ led, red 1"
    );
    let [led, robot, wall] = ['⬟', '→', '◆'].map(|symbol| find(&lines, symbol).1);
    assert!(led < wall && wall < robot, "{led} {wall} {robot}");
}

#[test]
fn styles_choose_colours() {
    let style = Style {
        kind: "agent".to_owned(),
        state: "free".to_owned(),
        color: "#102030".to_owned(),
        shape: String::new(),
    };
    let scene = Scene {
        styles: vec![style],
        ..example()
    };
    let painted = TextStyle {
        color: true,
        ..TextStyle::default()
    };
    let legend = render(&scene, painted)[23].clone();
    assert!(
        legend.starts_with("\x1b[38;2;16;32;48m●\x1b[0m free 1"),
        "{legend:?}"
    );
}
