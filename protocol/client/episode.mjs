// Plays one episode with the classes that `generate.mjs` has made: discovery, parameters, control, then actuators for each
// sensor message until the fitness comes, which is printed.
//
//     node protocol/generate.mjs javascript messages.mjs
//     node protocol/client/episode.mjs messages.mjs mqtt://localhost:1883 '{"maxSteps": 15}' 0.25
import { resolve } from "node:path";
import { pathToFileURL } from "node:url";

import mqtt from "mqtt";

const [module, broker, parameters, heading] = process.argv.slice(2);
const messages = await import(pathToFileURL(resolve(module)).href);
const { Actuator, Control, Discovery, Fitness, Parameters, Requirements, Sensor, Server } = messages;
const simulationHash = `episode ${process.pid} of the generated client`;
const seen = { sensors: [] };

const { SWARMWRIGHT_USERNAME: username, SWARMWRIGHT_PASSWORD: password } = process.env;
const client = mqtt.connect(broker, { username, password });
const send = (topic, message) => client.publish(topic, message.marshal());

const receive = {
  server(text) {
    const { server, simulationHash: answered, capabilities } = Server.unmarshal(text);
    if (answered !== simulationHash || seen.server !== undefined) return;
    Object.assign(seen, { server, dimensions: capabilities.dimensions, modes: capabilities.swarmwright?.modes });
    const flat = new Map(Object.entries(JSON.parse(parameters)));
    send("parameters", new Parameters({ server, simulationHash, additionalProperties: flat }));
    send("control", new Control({ server, simulationHash, simulation: "minisim", run: true }));
  },
  sensor(text) {
    const { simulationHash: hash, agent, sensor } = Sensor.unmarshal(text);
    if (hash !== simulationHash) return;
    seen.sensors.push(sensor);
    send("actuator", new Actuator({ simulationHash, agent, actuator: [Number(heading)] }));
  },
  fitness(text) {
    const { simulationHash: hash, fitness } = Fitness.unmarshal(text);
    if (hash !== simulationHash) return;
    console.log(JSON.stringify({ ...seen, fitness }));
    client.end();
  },
};

client.on("message", (topic, payload) => receive[topic](payload.toString()));
client.on("connect", () => {
  client.stream.setNoDelay?.(true);
  client.subscribe(Object.keys(receive), () => {
    const requirements = new Requirements({ dimensions: 2 });
    send("discovery", new Discovery({ simulation: "minisim", simulationHash, requirements }));
  });
});
setTimeout(() => {
  console.error("no fitness came within 20 s");
  process.exit(1);
}, 20_000).unref();
