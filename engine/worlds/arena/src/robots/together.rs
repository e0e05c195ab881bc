//! Inputs and outputs of one controller for robots of several kinds.

use std::mem::discriminant;
use std::ops::Range;

use super::outputs::Output;
use super::robot::{Group, Robot};

/// The inputs and outputs of a controller for all kinds.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Names of the inputs; where kinds share a number with different meanings, all their names.
    pub sensors: Vec<String>,
    /// Names of the outputs.
    pub actuators: Vec<String>,
    /// Names of the inputs and outputs that each kind uses.
    pub own: Vec<Own>,
    /// Index of the first output for the drive, for each kind.
    pub drives: Vec<usize>,
    /// Index of the first output for LEDs, for each kind.
    pub leds: Vec<usize>,
    /// Index of the output for grippers, if a kind has one.
    pub gripper: Option<usize>,
    /// Outputs for the longest message; shorter messages use the first ones.
    pub message: Range<usize>,
}

/// Name of the output for grippers.
const GRIPPER: &str = "gripper";

/// A kind's names of its inputs and outputs; `None` for those of other kinds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Own {
    pub sensors: Vec<Option<String>>,
    pub actuators: Vec<Option<String>>,
}

/// Numbers that some of the kinds have.
struct Column<T> {
    of: T,
    names: Vec<String>,
    directions: Vec<f32>,
    /// The kinds that have these numbers.
    owners: Vec<usize>,
}

/// Arranges the inputs and outputs of all kinds in one row.
///
/// If all kinds have equally many numbers, they share them, number by number. Otherwise they share sensors of the same
/// kind with the same names and directions; kinds without a sensor receive its neutral value. Drives of the same kind
/// share their numbers. All robots receive as many values of messages as the longest message has.
pub fn arrange(groups: &mut [Group]) -> Row {
    let longest = longest(groups);
    for group in groups.iter_mut() {
        group.robot.heard = longest.len();
    }
    let same = |count: fn(&Robot) -> usize| {
        let first = count(&groups[0].robot);
        groups.iter().all(|group| count(&group.robot) == first)
    };
    let (same_sensors, same_leds) = (same(Robot::sensors), same(|robot| robot.leds.len()));
    let mut own = vec![Own::default(); groups.len()];
    let sensors = if same_sensors {
        for (own, group) in own.iter_mut().zip(groups.iter()) {
            own.sensors = all(group.robot.sensor_names());
        }
        beside(groups, Robot::sensor_names)
    } else {
        let columns = columns(groups, |robot| {
            let outputs = robot.outputs.iter();
            outputs
                .map(|output| (*output, robot.names(*output), robot.directions(*output)))
                .collect()
        });
        for (index, group) in groups.iter_mut().enumerate() {
            own[index].sensors = of_kind(&columns, index);
            group.robot.outputs = columns.iter().map(|column| output(column, index)).collect();
        }
        named(&columns, groups)
    };
    let drives = columns(groups, |robot| {
        let names = robot.drive.actuators().iter();
        let names = names.map(|name| (*name).to_owned()).collect();
        vec![(discriminant(&robot.drive), names, Vec::new())]
    });
    let mut actuators = Vec::new();
    for column in &drives {
        let names = column.names.iter();
        actuators.extend(names.map(|name| of_kinds(name, &column.owners, groups)));
    }
    for (index, own) in own.iter_mut().enumerate() {
        own.actuators = of_kind(&drives, index);
    }
    let drive = actuators.len();
    let drives = places(&drives, 0, groups.len());
    let leds = if same_leds {
        actuators.extend(beside(groups, Robot::led_names));
        for (own, group) in own.iter_mut().zip(groups.iter()) {
            own.actuators.extend(all(group.robot.led_names()));
        }
        vec![drive; groups.len()]
    } else {
        let columns = columns(groups, |robot: &Robot| {
            let leds = (robot.leds.clone(), robot.led_names(), Vec::new());
            Vec::from_iter((!robot.leds.is_empty()).then_some(leds))
        });
        actuators.extend(named(&columns, groups));
        for (index, own) in own.iter_mut().enumerate() {
            own.actuators.extend(of_kind(&columns, index));
        }
        places(&columns, drive, groups.len())
    };
    let grips = groups.iter().any(|group| group.robot.gripper.is_some());
    let gripper = grips.then_some(actuators.len());
    actuators.extend(grips.then(|| GRIPPER.to_owned()));
    let message = actuators.len()..actuators.len() + longest.len();
    for (number, name) in longest.iter().enumerate() {
        let sends = |kind: &usize| groups[*kind].robot.message > number;
        let senders: Vec<usize> = (0..groups.len()).filter(sends).collect();
        actuators.push(of_kinds(name, &senders, groups));
    }
    for (own, group) in own.iter_mut().zip(groups.iter()) {
        let robot = &group.robot;
        let gripper = || robot.gripper.is_some().then(|| GRIPPER.to_owned());
        own.actuators.extend(grips.then(gripper));
        let sent =
            |(number, name): (usize, &String)| (number < robot.message).then(|| name.clone());
        own.actuators.extend(longest.iter().enumerate().map(sent));
    }
    Row {
        sensors,
        actuators,
        own,
        drives,
        leds,
        gripper,
        message,
    }
}

/// Marks all names as the kind's own.
fn all(names: Vec<String>) -> Vec<Option<String>> {
    names.into_iter().map(Some).collect()
}

/// Returns a kind's own names in all columns.
fn of_kind<T>(columns: &[Column<T>], kind: usize) -> Vec<Option<String>> {
    let names = columns.iter().flat_map(|column| {
        let has = column.owners.contains(&kind);
        let names = column.names.iter();
        names.map(move |name| has.then(|| name.clone()))
    });
    names.collect()
}

/// Returns the names of the values in the longest message.
fn longest(groups: &[Group]) -> Vec<String> {
    let messages = groups.iter().map(|group| group.robot.message_names());
    messages.max_by_key(Vec::len).unwrap_or_default()
}

/// Returns the output of a kind in a column.
fn output(column: &Column<Output>, kind: usize) -> Output {
    if column.owners.contains(&kind) {
        column.of
    } else {
        // A sensor has at most 128 readings.
        Output::Absent(column.names.len() as u8, column.of.neutral())
    }
}

/// Returns the index of the first number of each kind, for columns that begin at `first`.
fn places<T>(columns: &[Column<T>], first: usize, kinds: usize) -> Vec<usize> {
    let mut places = vec![first; kinds];
    let mut at = first;
    for column in columns {
        for owner in &column.owners {
            places[*owner] = at;
        }
        at += column.names.len();
    }
    places
}

/// Returns the columns of all kinds, in order of first use.
fn columns<T: PartialEq>(
    groups: &[Group],
    of: impl Fn(&Robot) -> Vec<(T, Vec<String>, Vec<f32>)>,
) -> Vec<Column<T>> {
    let mut columns: Vec<Column<T>> = Vec::new();
    for (index, group) in groups.iter().enumerate() {
        for (output, names, directions) in of(&group.robot) {
            let existing = columns.iter_mut().find(|column| {
                column.of == output && column.names == names && column.directions == directions
            });
            match existing {
                Some(column) => column.owners.push(index),
                None => columns.push(Column {
                    of: output,
                    names,
                    directions,
                    owners: vec![index],
                }),
            }
        }
    }
    columns
}

/// Returns the names of all columns. Ambiguous names are prefixed with the kinds that have them.
fn named<T>(columns: &[Column<T>], groups: &[Group]) -> Vec<String> {
    let mut names = Vec::new();
    for (index, column) in columns.iter().enumerate() {
        let twice = columns.iter().enumerate().any(|(other, sibling)| {
            other != index && sibling.names.iter().any(|name| column.names.contains(name))
        });
        let names_of = column.names.iter().map(|name| {
            if twice {
                with_kinds(name, &column.owners, groups)
            } else {
                name.clone()
            }
        });
        names.extend(names_of);
    }
    names
}

/// Prefixes a name with the kinds that have it.
fn with_kinds(name: &str, owners: &[usize], groups: &[Group]) -> String {
    let kinds = owners.iter().map(|owner| &groups[*owner].name[..]);
    let kinds = kinds.collect::<Vec<_>>().join(" and ");
    format!("{kinds} {name}")
}

/// Prefixes a name with the kinds that have it, unless all kinds do.
fn of_kinds(name: &str, owners: &[usize], groups: &[Group]) -> String {
    if owners.len() == groups.len() {
        name.to_owned()
    } else {
        with_kinds(name, owners, groups)
    }
}

/// Returns the names of numbers that kinds share one by one; where kinds differ, with all their names.
fn beside(groups: &[Group], of: impl Fn(&Robot) -> Vec<String>) -> Vec<String> {
    let mut names: Vec<Vec<String>> = Vec::new();
    for group in groups {
        for (index, name) in of(&group.robot).into_iter().enumerate() {
            match names.get_mut(index) {
                None => names.push(vec![name]),
                Some(alternatives) if !alternatives.contains(&name) => alternatives.push(name),
                Some(_) => {}
            }
        }
    }
    names.into_iter().map(|same| same.join(" or ")).collect()
}
