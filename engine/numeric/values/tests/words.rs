//! Errors say what was found and what is expected, without names of types of Rust, and where.

use serde::Deserialize;
use serde_json::{Value, json};
use swarmwright_values::{Mismatch, plain, read, read_kind};

#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wall {
    ends: [f32; 2],
    #[serde(default)]
    count: u32,
    color: Option<Color>,
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Color {
    Red,
    LightBlue,
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Sensor {
    Camera {
        range: f32,
        #[serde(default)]
        walls: Vec<Wall>,
        #[serde(default)]
        on: bool,
    },
    Clock {},
}

fn wrong<T>(result: Result<T, Mismatch>) -> [String; 2] {
    let Err(Mismatch { path, reason }) = result else {
        unreachable!("it was read")
    };
    [path, reason]
}

#[test]
fn what_fits_is_read() {
    let wall = read::<Wall>(&json!({"ends": [0, 1.5], "color": "light_blue"}));
    let expected = Wall {
        ends: [0.0, 1.5],
        count: 0,
        color: Some(Color::LightBlue),
    };
    assert_eq!(wall, Ok(expected));
    assert_eq!(read_kind(&json!({"kind": "clock"})), Ok(Sensor::Clock {}));
    let camera = Sensor::Camera {
        range: 2.0,
        walls: Vec::new(),
        on: true,
    };
    let text = json!({"range": 2, "kind": "camera", "on": true});
    assert_eq!(read_kind(&text), Ok(camera));
}

#[test]
fn structures() {
    let long = "x".repeat(50);
    let cases = [
        (
            json!({"ends": [0, "1"]}),
            "ends[1]",
            "\"1\" (a string) found, expected a number",
        ),
        (
            json!({"ends": [0]}),
            "ends",
            "1 item found, expected a list of 2",
        ),
        (
            json!({"ends": [0, 1], "count": -1}),
            "count",
            "-1 found, expected a whole number of at least 0",
        ),
        (
            json!({"ends": [0, 1], "count": 1.5}),
            "count",
            "1.5 found, expected a whole number of at least 0",
        ),
        (
            json!({"ends": [0, 1], "count": {}}),
            "count",
            "an object found, expected a whole number of at least 0",
        ),
        (
            json!({"ends": null}),
            "ends",
            "null found, expected a list of 2",
        ),
        (
            json!({"ends": true}),
            "ends",
            "true found, expected a list of 2",
        ),
        (
            json!({"ends": [0, 1], "color": "blue"}),
            "color",
            "\"blue\" found, expected \"red\" or \"light_blue\"",
        ),
        (
            json!({"ends": [0, 1], "color": 3}),
            "color",
            "3 found, expected a name",
        ),
        (
            json!({"ends": [0, 1], "colour": "red"}),
            "colour",
            "unknown field `colour`, expected one of `ends`, `count`, `color`; did you mean \"color\"?",
        ),
        (json!({}), "", "missing field `ends`"),
        (json!([]), "", "a list found, expected an object"),
        (
            json!([[0, 1], 0, null]),
            "",
            "a list found, expected an object",
        ),
        (
            json!("a wall"),
            "",
            "\"a wall\" (a string) found, expected an object",
        ),
    ];
    for (value, path, reason) in cases {
        assert_eq!(wrong(read::<Wall>(&value)), [path, reason], "{value}");
    }
    let cut = wrong(read::<Wall>(&Value::String(long)));
    assert_eq!(
        cut[1],
        format!(
            "\"{}... (a string) found, expected an object",
            "x".repeat(36)
        )
    );
}

#[test]
fn kinds() {
    let cases = [
        (
            json!({"kind": "camera", "range": "far"}),
            "range",
            "\"far\" (a string) found, expected a number",
        ),
        (
            json!({"kind": "camera", "range": 1, "on": 1}),
            "on",
            "1 found, expected true or false",
        ),
        (
            json!({"kind": "camera", "range": 1, "walls": [{"ends": [0, {}]}]}),
            "walls[0].ends[1]",
            "an object found, expected a number",
        ),
        (
            json!({"kind": "camera", "range": 1, "walls": [[[0, 1], 2]]}),
            "walls[0]",
            "a list found, expected an object",
        ),
        (json!({"kind": "camera"}), "", "missing field `range`"),
        (
            json!({"kind": "camera", "rnage": 1}),
            "rnage",
            "unknown field `rnage`, expected one of `range`, `walls`, `on`; did you mean \"range\"?",
        ),
        (
            json!({"kind": "cam"}),
            "kind",
            "\"cam\" found, expected \"camera\" or \"clock\"; did you mean \"camera\"?",
        ),
        (json!({"kind": 3}), "kind", "3 found, expected a string"),
        (json!({}), "", "missing field `kind`"),
        (
            json!(["camera"]),
            "",
            "a list found, expected an object with a kind",
        ),
    ];
    for (value, path, reason) in cases {
        assert_eq!(
            wrong(read_kind::<Sensor>(&value)),
            [path, reason],
            "{value}"
        );
    }
}

#[test]
fn other_words_stay() {
    for words in [
        "",
        "invalid",
        "invalid utf-8",
        "unknown",
        "nothing of the kind",
        "must be at least 1",
    ] {
        assert_eq!(plain(words), words);
    }
}

#[test]
fn places_in_a_text_stay() {
    let error = serde_json::from_str::<Vec<f32>>("[1, \"at line 2\"]").unwrap_err();
    let expected = "\"at line 2\" (a string) found, expected a number, at line 1 column 15";
    assert_eq!(plain(&error.to_string()), expected);
}
