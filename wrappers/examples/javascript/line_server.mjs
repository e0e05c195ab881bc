// A simulation server of the D6.1 profile, without extensions. Its world is a line: one agent senses its
// position and sets its speed; the closer it ends to 0, the better.
//
//     node line_server.mjs mqtt://localhost:1883 4711
import mqtt from "mqtt";

const [broker, id] = [process.argv[2], Number(process.argv[3])];
const STEPS = 20;

// What the messages have, as the schemas of section 6.2 say. Other messages are not valid in D6.1.
const text = (value) => typeof value === "string";
const number = (value) => typeof value === "number" && Number.isFinite(value);
const flag = (value) => typeof value === "boolean";
const object = (value) => typeof value === "object" && value !== null && !Array.isArray(value);
const optional = (fits) => (value) => value === undefined || fits(value);
const SCHEMAS = {
  discovery: {
    simulation: text,
    simulation_hash: text,
    requirements: (value) => object(value) && number(value.dimensions) && optional(number)(value.max_agents),
  },
  parameters: { server: Number.isInteger, simulation_hash: text, start: optional(number) },
  control: { server: Number.isInteger, simulation_hash: text, run: optional(flag), visual: optional(flag) },
  actuator: {
    simulation_hash: text,
    agent: Number.isInteger,
    actuator: (value) => Array.isArray(value) && value.length > 0 && value.every(number),
  },
};

let parameters = {}; // received last
let episode = null; // under way: its hash, where the agent is, steps made

const handlers = {
  // Every server that is available and fulfils the requirements answers (5.2.3, 6.2, 7.2.2).
  discovery({ simulation, simulation_hash, requirements }) {
    const fits = requirements.dimensions === 1 && (requirements.max_agents ?? 1) <= 1;
    if (episode === null && simulation === "line" && fits) {
      const capabilities = { dimensions: 1, "max agents": 1 };
      publish("server", { server: id, simulation_hash, simulations: ["line"], capabilities });
    }
  },

  // Published every time before starting a simulation (6.2).
  parameters(message) {
    if (message.server === id) parameters = message;
  },

  // Starts the simulation with the parameters received earlier, or terminates it (6.2).
  control({ server, simulation_hash, run = true }) {
    if (server !== id) return;
    if (run && episode === null && parameters.simulation_hash === simulation_hash) {
      episode = { hash: simulation_hash, x: parameters.start ?? 5, step: 0 };
      sense();
    } else if (!run && episode?.hash === simulation_hash) {
      episode = null;
    }
  },

  // Executes the actuator commands of the agent that is addressed (6.2).
  actuator({ simulation_hash, agent, actuator }) {
    if (simulation_hash !== episode?.hash || agent !== 0) return;
    episode.x += actuator[0];
    episode.step += 1;
    if (episode.step < STEPS) {
      sense();
    } else {
      // "When the maximum number of simulation steps has been reached" (6.2).
      publish("fitness", { simulation_hash, fitness: -Math.abs(episode.x) });
      episode = null;
    }
  },
};

function sense() {
  publish("sensor", { simulation_hash: episode.hash, agent: 0, sensor: [episode.x] });
}

function publish(topic, message) {
  client.publish(topic, JSON.stringify(message));
}

const { SWARMWRIGHT_USERNAME: username, SWARMWRIGHT_PASSWORD: password } = process.env;
const client = mqtt.connect(broker, { username, password });
client.on("connect", () => {
  client.stream.setNoDelay?.(true); // small messages need not wait for each other
  client.subscribe(Object.keys(SCHEMAS), () => console.log("serving"));
});
client.on("error", (error) => console.error(error.message));
client.on("message", (topic, payload) => {
  let message;
  try {
    message = JSON.parse(payload);
  } catch {
    return;
  }
  const schema = Object.entries(SCHEMAS[topic]);
  if (object(message) && schema.every(([key, fits]) => fits(message[key]))) handlers[topic](message);
});
