//! Scenes of the arena.

use std::borrow::Cow;

use swarmwright_lanes::Mask;
use swarmwright_simulation::{Body, Light, Patch, Ray, Scene, Style, Wall};

use crate::place::{Face, Form, LedColor, Place, Pose, Shape};
use crate::robots::Team;
use crate::rules::{CARRIES, CAUGHT};
use crate::sensing::radio::both;
use crate::settings::Settings;
use crate::start::objects::{corners, distance as to_object};
use crate::swarm::Swarm;

/// Maximum number of robots for which rays and links are shown; more would hide everything else.
const MOST_IN_DETAIL: usize = 1000;
/// Margin shown around a lamp, metres.
const AROUND_LIGHT: f32 = 0.1;
/// Number of corners that approximate a disc-shaped object.
const CORNERS: u16 = 48;
/// Radius of a coloured lamp in pictures, metres.
const LAMP: f32 = 0.015;
/// Radius of the mark for a robot's LEDs, as a fraction of the robot's radius.
const LED: f32 = 0.45;
/// Colour for LEDs that are off, which pictures leave out.
const DARK: &str = "#8c8c8c";
/// Colour of objects without a colour of their own.
const COLOR: &str = "#e69f00";
/// Distance below which ends of faces count as the same corner, metres.
const SAME: f32 = 1e-4;

/// Returns the scene of an episode that runs in a single lane.
pub fn scene(settings: &Settings, swarm: &Swarm<f32>) -> Scene {
    let (layout, team) = (&settings.mission.place, &settings.team);
    let [low, high] = shown(layout);
    let shifted = |points: Vec<[f32; 2]>| -> Vec<[f32; 2]> {
        let shift = |[x, y]: [f32; 2]| [x - low[0], y - low[1]];
        points.into_iter().map(shift).collect()
    };
    // The outer walls come first.
    let chains = chains(&layout.faces);
    let outline = chains.first().filter(|chain| chain.closed);
    let bodies = (0..swarm.bodies.len()).map(|index| Body {
        kind: "agent".into(),
        x: swarm.bodies.x[index].0 - low[0],
        y: swarm.bodies.y[index].0 - low[1],
        radius: team.robot(index).radius,
        state: state(team, swarm, index),
        heading: Some(swarm.bodies.heading[index].0 * std::f32::consts::PI),
        ..Body::default()
    });
    let mut scene = Scene {
        width: high[0] - low[0],
        height: high[1] - low[1],
        origin: low,
        step: swarm.tick - 1,
        message: settings.mission.title.clone(),
        bodies: bodies.collect(),
        floor: Some(Patch {
            points: shifted(
                outline
                    .map(|chain| chain.points.clone())
                    .unwrap_or_default(),
            ),
            grey: layout.grey,
            ..Patch::default()
        }),
        ..Scene::default()
    };
    let style = |state: &str, color: &str| Style {
        kind: "led".to_owned(),
        state: state.to_owned(),
        color: color.to_owned(),
        shape: "circle".to_owned(),
    };
    let lit = |color: &&LedColor| team.any(|robot| robot.leds.contains(*color));
    let leds = LedColor::ALL.iter().filter(lit);
    scene
        .styles
        .extend(leds.map(|color| style(color.name(), color.shown())));
    if !scene.styles.is_empty() {
        scene.styles.push(style("", DARK));
    }
    for group in team.groups() {
        let Some(color) = group.robot.color else {
            continue;
        };
        let look = |state: String, color: &str| Style {
            kind: "agent".to_owned(),
            state,
            color: color.to_owned(),
            shape: "circle".to_owned(),
        };
        scene.styles.push(look(group.name.clone(), color.shown()));
        let rules = &settings.mission.rules;
        if rules.catch(&group.name) {
            let state = format!("{}, {CAUGHT}", group.name);
            scene.styles.push(look(state, color.pale()));
        }
        if rules.carry(&group.name) {
            let state = format!("{}, {CARRIES}", group.name);
            scene.styles.push(look(state, color.dark()));
        }
    }
    for (patch, color) in layout.patches.iter().zip(&swarm.colors) {
        let (points, radius) = outline_of(&patch.shape, low, high);
        scene.patches.push(Patch {
            points: shifted(points),
            radius,
            grey: color.0,
            name: patch.name.clone(),
        });
    }
    for (index, chain) in chains.into_iter().enumerate() {
        let mut points = shifted(chain.points);
        let solid = index > 0 && chain.closed;
        if chain.closed && !solid {
            points.extend(points.first().copied());
        }
        scene.walls.push(Wall { points, solid });
    }
    for (pose, form, name, color) in objects(layout, swarm) {
        // Objects are outlined, to distinguish them from obstacles, which are filled.
        let mut points = shifted(rim(form, pose));
        points.extend(points.first().copied());
        scene.walls.push(Wall {
            points,
            solid: false,
        });
        scene.bodies.push(Body {
            kind: "object".into(),
            x: pose.at[0] - low[0],
            y: pose.at[1] - low[1],
            state: color.map_or("", LedColor::name).into(),
            label: name.to_owned().into(),
            ..Body::default()
        });
    }
    let lamps = layout.lights.iter().filter_map(|light| {
        let [x, y, _] = light.at;
        light.color.map(|color| ([x, y], color))
    });
    let lamps: Vec<([f32; 2], LedColor)> = lamps.collect();
    scene
        .bodies
        .extend(lamps.iter().map(|([x, y], color)| Body {
            kind: "lamp".into(),
            x: x - low[0],
            y: y - low[1],
            state: color.name().into(),
            radius: LAMP,
            ..Body::default()
        }));
    // Each coloured wall is a line that extends by `radius` to both sides of its middle.
    scene.bodies.extend(layout.spots.iter().map(|spot| Body {
        kind: "wall".into(),
        x: spot.at[0] - low[0],
        y: spot.at[1] - low[1],
        state: spot.color.name().into(),
        radius: spot.half,
        heading: Some(spot.along[1].atan2(spot.along[0])),
        ..Body::default()
    }));
    scene.bodies.extend(led_bodies(team, swarm, low));
    for color in LedColor::ALL {
        let lit = lamps.iter().any(|(_, of_lamp)| *of_lamp == color);
        let covered = layout.spots.iter().any(|spot| spot.color == color);
        let painted = layout.objects.iter().any(|kind| kind.color == Some(color));
        for (present, kind, shape) in [
            (lit, "lamp", "circle"),
            (covered, "wall", "square"),
            (painted, "object", "diamond"),
        ] {
            if present {
                scene.styles.push(Style {
                    kind: kind.to_owned(),
                    state: color.name().to_owned(),
                    color: color.shown().to_owned(),
                    shape: shape.to_owned(),
                });
            }
        }
    }
    if !layout.objects.is_empty() {
        scene.styles.push(Style {
            kind: "object".to_owned(),
            color: COLOR.to_owned(),
            shape: "diamond".to_owned(),
            ..Style::default()
        });
    }
    // A lamp of intensity 0 sheds no light: only cameras see its colour.
    let shining = layout.lights.iter().filter(|light| light.intensity > 0.0);
    scene.lights.extend(shining.map(|light| Light {
        x: light.at[0] - low[0],
        y: light.at[1] - low[1],
        intensity: light.intensity,
    }));
    if swarm.bodies.len() <= MOST_IN_DETAIL {
        look(&mut scene, team, layout, swarm);
    }
    scene
}

/// Returns the text that distinguishes a robot: its kind, if there are several, and its state.
fn state(team: &Team, swarm: &Swarm<f32>, index: usize) -> Cow<'static, str> {
    let state = swarm.state(index);
    match team.groups() {
        [_] => state.unwrap_or_default().into(),
        groups => {
            let kind = Some(groups[team.group(index)].name.as_str());
            let words: Vec<_> = kind.into_iter().chain(state).collect();
            words.join(", ").into()
        }
    }
}

/// Returns the LEDs of all robots that have some. LEDs that are off are included, without a state, because all scenes
/// must have the same bodies.
fn led_bodies<'a>(
    team: &'a Team,
    swarm: &'a Swarm<f32>,
    low: [f32; 2],
) -> impl Iterator<Item = Body> + 'a {
    let with = (0..swarm.bodies.len()).filter(|index| !team.robot(*index).leds.is_empty());
    with.map(move |index| Body {
        kind: "led".into(),
        x: swarm.bodies.x[index].0 - low[0],
        y: swarm.bodies.y[index].0 - low[1],
        radius: LED * team.robot(index).radius,
        state: led(swarm, index).into(),
        ..Body::default()
    })
}

/// Returns the colour of a robot's LEDs; empty if they are off.
fn led(swarm: &Swarm<f32>, index: usize) -> &'static str {
    let code = swarm
        .senses
        .shown
        .get(index)
        .map_or(0, |code| code.0 as usize);
    let color = code.checked_sub(1).and_then(|at| LedColor::ALL.get(at));
    color.map_or("", |color| color.name())
}

/// Returns the lower left and upper right corners of the picture: the walls with a margin, and nearby lamps outside of
/// them.
fn shown(layout: &Place) -> [[f32; 2]; 2] {
    let [mut low, mut high] = layout.extent();
    let size = [high[0] - low[0], high[1] - low[1]];
    for light in &layout.lights {
        for axis in 0..2 {
            let at = light.at[axis];
            if at > low[axis] - size[axis] / 2.0 && at < high[axis] + size[axis] / 2.0 {
                low[axis] = low[axis].min(at - AROUND_LIGHT);
                high[axis] = high[axis].max(at + AROUND_LIGHT);
            }
        }
    }
    [low, high]
}

/// Returns poses, forms, names and colours of the objects.
fn objects<'a>(
    layout: &'a Place,
    swarm: &'a Swarm<f32>,
) -> impl Iterator<Item = (Pose, Form, &'a str, Option<LedColor>)> {
    let objects = &swarm.bodies.objects;
    let all = objects.things.iter().zip(objects.poses());
    all.map(|(item, pose)| {
        let name = layout.objects[item.kind].name.as_str();
        (pose, item.form, name, item.color)
    })
}

/// Returns the corners of an object's outline.
fn rim(form: Form, pose: Pose) -> Vec<[f32; 2]> {
    match form {
        Form::Box { half } => corners(half, pose).to_vec(),
        Form::Disc { radius } => (0..CORNERS)
            .map(|corner| f32::from(corner) / f32::from(CORNERS) * std::f32::consts::TAU)
            .map(|angle| ahead(pose.at, [angle.cos(), angle.sin()], radius))
            .collect(),
    }
}

/// Returns whether a robot's messages reach nobody now: it is mute, or all messages are lost.
fn silent(swarm: &Swarm<f32>, sender: usize) -> bool {
    let links = &swarm.senses.links;
    let mute = links.mute.get(sender).is_some_and(|mute| mute.any());
    mute || links.failing.is_some_and(|loss| loss >= 1.0)
}

/// Adds the rays of the proximity sensors, without noise, and the links on which robots receive messages.
///
/// This is only for pictures and handles one robot at a time; the inputs of controllers are computed in lanes
/// elsewhere.
fn look(scene: &mut Scene, team: &Team, layout: &Place, swarm: &Swarm<f32>) {
    let bodies = &swarm.bodies;
    let at = |index: usize| [bodies.x[index].0, bodies.y[index].0];
    for index in 0..bodies.len() {
        let robot = team.robot(index);
        let others: Vec<([f32; 2], usize)> = swarm
            .verlet
            .of(index)
            .iter()
            .map(|other| (at(*other as usize), *other as usize))
            // In small swarms without neighbour lists, a robot is among its own neighbours.
            .filter(|(other, number)| {
                *number != index && distance(at(index), *other) < robot.range(team.radius())
            })
            .collect();
        if let Some(sensors) = &robot.proximity {
            let [cos, sin] = [bodies.cos[index].0, bodies.sin[index].0];
            for ray in &sensors.rays {
                let [x, y] = ray.along;
                let along = [x * cos - y * sin, x * sin + y * cos];
                let from = at(index);
                let robots = others.iter().filter_map(|(other, robot)| {
                    to_disc(from, along, *other, team.robot(*robot).radius)
                });
                let walls = layout.faces.iter();
                let walls = walls.filter_map(|face| to_wall(from, along, face));
                let pushed = objects(layout, swarm)
                    .filter_map(|(pose, form, ..)| to_form(from, along, form, pose));
                let distances = robots.chain(walls).chain(pushed);
                let distances = distances.map(|far| far - sensors.start);
                let distances = distances.filter(|far| *far >= sensors.least());
                let free = distances.fold(sensors.range, f32::min).max(0.0);
                let [c0, c1, c2] = sensors.response;
                let reading = ((free * c2 + c1) * free + c0).clamp(0.0, 1.0);
                scene.rays.push(Ray {
                    body: index as u32,
                    angle: y.atan2(x),
                    start: sensors.start,
                    length: free,
                    reading: Some(if free < sensors.range { reading } else { 0.0 }),
                });
            }
        }
        for (other, sender) in &others {
            if silent(swarm, *sender) {
                continue;
            }
            let heard = robot.links.as_ref();
            let range = heard.map_or(0.0, |links| both(links, team.robot(*sender)).sqrt());
            let away = distance(at(index), *other);
            let along = [0, 1].map(|axis| (other[axis] - at(index)[axis]) / away);
            let nearer = |hit: Option<f32>| hit.is_some_and(|hit| hit < away);
            let hidden = others.iter().any(|(third, number)| {
                number != sender
                    && nearer(to_disc(
                        at(index),
                        along,
                        *third,
                        team.robot(*number).radius,
                    ))
            });
            let inner = layout.faces.iter().filter(|face| !face.outer);
            let walls = inner.map(|face| to_wall(at(index), along, face));
            let pushed = objects(layout, swarm)
                .map(|(pose, form, ..)| to_form(at(index), along, form, pose));
            let through = heard.is_some_and(|links| !links.line_of_sight());
            if away < range && (through || !hidden && !walls.chain(pushed).any(nearer)) {
                scene.links.push([*sender as u32, index as u32]);
            }
        }
    }
}

fn distance(a: [f32; 2], b: [f32; 2]) -> f32 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn ahead([x, y]: [f32; 2], along: [f32; 2], far: f32) -> [f32; 2] {
    [x + far * along[0], y + far * along[1]]
}

/// Returns the distance to a disc along a ray that begins outside of it.
fn to_disc(from: [f32; 2], along: [f32; 2], middle: [f32; 2], radius: f32) -> Option<f32> {
    let [dx, dy] = [middle[0] - from[0], middle[1] - from[1]];
    let (forward, aside) = (dx * along[0] + dy * along[1], dx * along[1] - dy * along[0]);
    let depth = radius * radius - aside * aside;
    let far = forward - depth.max(0.0).sqrt();
    (depth > 0.0 && far >= 0.0).then_some(far)
}

/// Returns the distance to a wall along a ray.
fn to_wall(from: [f32; 2], along: [f32; 2], face: &Face) -> Option<f32> {
    let [dx, dy] = [face.middle[0] - from[0], face.middle[1] - from[1]];
    let across = along[0] * face.along[1] - along[1] * face.along[0];
    let far = (dx * face.along[1] - dy * face.along[0]) / across;
    let offset = (dx * along[1] - dy * along[0]) / across;
    // For parallel lines the results are not finite.
    (far >= 0.0 && far.is_finite() && offset.abs() <= face.half).then_some(far)
}

/// Returns the distance to an object along a ray; `None` if the ray begins inside it.
fn to_form(from: [f32; 2], along: [f32; 2], form: Form, pose: Pose) -> Option<f32> {
    if to_object((form, pose), from) <= 0.0 {
        return None;
    }
    match form {
        Form::Disc { radius } => to_disc(from, along, pose.at, radius),
        Form::Box { half } => {
            let corners = corners(half, pose);
            let next = corners.iter().cycle().skip(1);
            let sides = corners
                .iter()
                .zip(next)
                .filter_map(|(a, b)| to_wall(from, along, &Face::new(*a, *b, 1.0, false)));
            sides.reduce(f32::min)
        }
    }
}

/// Returns the corners of a shape, or the centre of a circle with its radius. Unbounded shapes are clipped to the
/// picture.
fn outline_of(shape: &Shape, least: [f32; 2], most: [f32; 2]) -> (Vec<[f32; 2]>, f32) {
    match shape {
        Shape::Circle { center, radius } => (vec![*center], *radius),
        Shape::Polygon { corners } => (corners.clone(), 0.0),
        Shape::Box { low, high } => {
            let [x, y] = [low[0].max(least[0]), low[1].max(least[1])];
            let [right, top] = [high[0].min(most[0]).max(x), high[1].min(most[1]).max(y)];
            (vec![[x, y], [right, y], [right, top], [x, top]], 0.0)
        }
    }
}

/// Consecutive faces, each of which begins where the previous one ends.
struct Chain {
    points: Vec<[f32; 2]>,
    /// Whether the last face ends where the first one begins; that corner is stored once.
    closed: bool,
}

/// Joins adjacent faces. Faces of outer walls are appended to a chain, faces of obstacles are prepended.
fn chains(faces: &[Face]) -> Vec<Chain> {
    let are_close =
        |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).abs() < SAME && (a[1] - b[1]).abs() < SAME;
    let mut chains: Vec<Chain> = Vec::new();
    for face in faces {
        let [from, to] = face.ends();
        if let Some(chain) = chains.last_mut().filter(|chain| !chain.closed) {
            let first = chain.points[0];
            let last = chain.points[chain.points.len() - 1];
            if are_close(last, from) && are_close(first, to) {
                chain.closed = true;
                continue;
            }
            if are_close(last, from) {
                chain.points.push(to);
                continue;
            }
            if are_close(first, to) {
                chain.points.insert(0, from);
                continue;
            }
        }
        chains.push(Chain {
            points: vec![from, to],
            closed: false,
        });
    }
    chains
}
