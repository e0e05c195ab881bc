//! Conversion between scenes and messages, for tools that show episodes of simulations that they do not have.

use std::borrow::Cow;
use std::cell::Cell;
use std::collections::HashMap;

use swarmwright_protocol::{
    Bodies, EXTENSION_VERSION, F32s, NO_AGENT, Rays, SceneLight, SceneMessage, ScenePatch,
    SceneScale, SceneStyle, SceneWall, U32s,
};
use swarmwright_worlds::{Body, Light, Patch, Ray, Scale, Scene, Style, Wall};

thread_local! {
    static SENT: Cell<bool> = const { Cell::new(false) };
}

/// Returns whether a scene requested in this thread is sent to a tool instead of being shown here; used by simulations
/// that display themselves.
#[must_use]
pub fn is_sent() -> bool {
    SENT.get()
}

/// Runs a call whose scenes are sent to a tool.
pub(crate) fn sending<T>(call: impl FnOnce() -> T) -> T {
    SENT.set(true);
    let done = call();
    SENT.set(false);
    done
}

/// Converts a scene to a message; rays and links are included only if they are among `parts`. The fields that identify
/// the episode and hold its measurements are left empty.
#[must_use]
pub fn to_message(scene: &Scene, parts: &[String]) -> SceneMessage {
    let is_wanted = |part: &str| parts.iter().any(|name| name == part);
    SceneMessage {
        version: EXTENSION_VERSION,
        step: scene.step.into(),
        width: scene.width,
        height: scene.height,
        origin: (scene.origin != [0.0; 2]).then_some(scene.origin),
        grid: scene.grid,
        message: scene.message.clone(),
        bodies: bodies(&scene.bodies),
        rays: (is_wanted("rays") && !scene.rays.is_empty()).then(|| rays(&scene.rays)),
        links: (is_wanted("links") && !scene.links.is_empty())
            .then(|| U32s(scene.links.as_flattened().to_vec())),
        floor: scene.floor.as_ref().map(patch),
        patches: scene.patches.iter().map(patch).collect(),
        walls: scene.walls.iter().map(wall).collect(),
        lights: scene.lights.iter().map(light).collect(),
        styles: scene.styles.iter().map(style).collect(),
        scale: scene.scale.as_ref().map(scale),
        ..SceneMessage::default()
    }
}

fn bodies(bodies: &[Body]) -> Bodies {
    let mut indices: HashMap<(&str, &str), u32> = HashMap::new();
    let mut looks = Vec::new();
    let look = bodies.iter().map(|body| {
        *indices.entry((&body.kind, &body.state)).or_insert_with(|| {
            looks.push([body.kind.to_string(), body.state.to_string()]);
            looks.len() as u32 - 1
        })
    });
    let look: Vec<u32> = look.collect();
    let numbers = |of: fn(&Body) -> f32| F32s(bodies.iter().map(of).collect());
    let any = |of: fn(&Body) -> bool| bodies.iter().any(of);
    let radius = bodies.first().map_or(0.0, |body| body.radius);
    #[expect(
        clippy::float_cmp,
        reason = "one number for all only where all are the same"
    )]
    let same = bodies.iter().all(|body| body.radius == radius);
    Bodies {
        look: (looks.len() > 1).then_some(U32s(look)),
        looks,
        x: numbers(|body| body.x),
        y: numbers(|body| body.y),
        radius: match (same, radius > 0.0) {
            (true, false) => None,
            (true, true) => Some(F32s(vec![radius])),
            (false, _) => Some(numbers(|body| body.radius)),
        },
        heading: any(|body| body.heading.is_some())
            .then(|| numbers(|body| body.heading.unwrap_or(f32::NAN))),
        value: any(|body| body.value.is_some())
            .then(|| numbers(|body| body.value.unwrap_or(f32::NAN))),
        agent: any(|body| body.agent.is_some()).then(|| {
            let agents = bodies.iter().map(|body| body.agent.unwrap_or(NO_AGENT));
            U32s(agents.collect())
        }),
        labels: if any(|body| !body.label.is_empty()) {
            bodies.iter().map(|body| body.label.to_string()).collect()
        } else {
            Vec::new()
        },
    }
}

fn rays(rays: &[Ray]) -> Rays {
    let numbers = |of: fn(&Ray) -> f32| F32s(rays.iter().map(of).collect());
    Rays {
        body: U32s(rays.iter().map(|ray| ray.body).collect()),
        angle: numbers(|ray| ray.angle),
        start: numbers(|ray| ray.start),
        length: numbers(|ray| ray.length),
        reading: rays
            .iter()
            .any(|ray| ray.reading.is_some())
            .then(|| numbers(|ray| ray.reading.unwrap_or(f32::NAN))),
    }
}

fn patch(patch: &Patch) -> ScenePatch {
    ScenePatch {
        grey: patch.grey,
        points: patch.points.clone(),
        radius: patch.radius,
        name: patch.name.clone(),
    }
}

fn wall(wall: &Wall) -> SceneWall {
    SceneWall {
        points: wall.points.clone(),
        solid: wall.solid,
    }
}

fn light(light: &Light) -> SceneLight {
    SceneLight {
        x: light.x,
        y: light.y,
        intensity: light.intensity,
    }
}

fn style(style: &Style) -> SceneStyle {
    SceneStyle {
        kind: style.kind.clone(),
        state: style.state.clone(),
        color: style.color.clone(),
        shape: style.shape.clone(),
    }
}

fn scale(scale: &Scale) -> SceneScale {
    SceneScale {
        name: scale.name.clone(),
        low: scale.low,
        high: scale.high,
    }
}

/// Converts a message to a scene; its arrays must match, which the decoder checks.
#[must_use]
pub fn from_message(message: SceneMessage) -> Scene {
    Scene {
        width: message.width,
        height: message.height,
        origin: message.origin.unwrap_or_default(),
        grid: message.grid,
        step: u32::try_from(message.step).unwrap_or(u32::MAX),
        message: plain(message.message),
        bodies: read_bodies(message.bodies),
        rays: message.rays.map(read_rays).unwrap_or_default(),
        links: message
            .links
            .map_or_else(Vec::new, |links| links.0.as_chunks::<2>().0.to_vec()),
        floor: message.floor.map(read_patch),
        patches: message.patches.into_iter().map(read_patch).collect(),
        walls: (message.walls.into_iter())
            .map(|SceneWall { points, solid }| Wall { points, solid })
            .collect(),
        lights: (message.lights.into_iter())
            .map(|SceneLight { x, y, intensity }| Light { x, y, intensity })
            .collect(),
        styles: message.styles.into_iter().map(read_style).collect(),
        scale: message.scale.map(|SceneScale { name, low, high }| Scale {
            name: plain(name),
            low,
            high,
        }),
    }
}

/// Largest number of characters of a peer's text that are shown.
const MOST_CHARACTERS: usize = 200;

/// Limits the length of a peer's text and removes control characters, since it is shown in terminals and on pages.
fn plain(text: String) -> String {
    if text.len() <= MOST_CHARACTERS && !text.chars().any(char::is_control) {
        return text;
    }
    let shown = text.chars().filter(|character| !character.is_control());
    shown.take(MOST_CHARACTERS).collect()
}

fn read_bodies(bodies: Bodies) -> Vec<Body> {
    let Bodies {
        looks,
        look,
        x,
        y,
        radius,
        heading,
        value,
        agent,
        labels,
    } = bodies;
    let at = |numbers: &Option<F32s>, index: usize| {
        let number = numbers.as_ref()?.0.get(index).copied()?;
        Some(number).filter(|number| !number.is_nan())
    };
    let single = radius.as_ref().is_some_and(|radius| radius.0.len() == 1);
    let looks: Vec<[String; 2]> = looks.into_iter().map(|look| look.map(plain)).collect();
    let mut labels = labels.into_iter();
    let look_of = |index: usize| look.as_ref().map_or(0, |look| look.0[index] as usize);
    (0..x.0.len())
        .map(|index| {
            let [kind, state] = looks.get(look_of(index)).cloned().unwrap_or_default();
            Body {
                kind: kind.into(),
                state: state.into(),
                x: x.0[index],
                y: y.0[index],
                radius: at(&radius, if single { 0 } else { index }).unwrap_or(0.0),
                heading: at(&heading, index),
                value: at(&value, index),
                label: labels
                    .next()
                    .map_or(Cow::Borrowed(""), |label| Cow::Owned(plain(label))),
                agent: agent
                    .as_ref()
                    .and_then(|agent| agent.0.get(index).copied())
                    .filter(|agent| *agent != NO_AGENT),
            }
        })
        .collect()
}

fn read_rays(rays: Rays) -> Vec<Ray> {
    let reading = |index: usize| {
        let readings = rays.reading.as_ref()?;
        readings
            .0
            .get(index)
            .copied()
            .filter(|reading| !reading.is_nan())
    };
    (0..rays.body.0.len())
        .map(|index| Ray {
            body: rays.body.0[index],
            angle: rays.angle.0[index],
            start: rays.start.0[index],
            length: rays.length.0[index],
            reading: reading(index),
        })
        .collect()
}

fn read_patch(patch: ScenePatch) -> Patch {
    let ScenePatch {
        grey,
        points,
        radius,
        name,
    } = patch;
    Patch {
        points,
        radius,
        grey,
        name: plain(name),
    }
}

fn read_style(style: SceneStyle) -> Style {
    let SceneStyle {
        kind,
        state,
        color,
        shape,
    } = style;
    Style {
        kind: plain(kind),
        state: plain(state),
        color,
        shape,
    }
}
