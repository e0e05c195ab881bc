package org.swarmwright.messages;

import com.google.gson.Gson;
import com.google.gson.GsonBuilder;
import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import com.google.gson.ToNumberPolicy;
import com.google.gson.reflect.TypeToken;
import java.nio.charset.StandardCharsets;
import java.util.ArrayList;
import java.util.HashSet;
import java.util.List;
import java.util.Map;
import java.util.Set;
import java.util.function.DoubleFunction;

/**
 * Turns payloads into the classes generated from protocol/schemas, and back.
 *
 * <p>Reading is strict where D6.1 is (required keys, types, finite numbers) and ignores unknown
 * keys. Every {@code read} method throws {@link MessageException}, which says what is wrong.
 */
public final class Messages {
  /** Most sides of a match, and most groups of a side. */
  private static final int MOST_SIDES = 256;

  /** Most characters of the names of a side, its groups and its fitness. */
  private static final int MOST_NAME = 100;

  private static final Set<String> ADDRESS = Set.of("server", "simulation_hash");
  private static final Gson GSON = gson(Decimals::shortest);

  /** For binary32 numbers. */
  private static final Gson SINGLES = gson(number -> Decimals.shortest((float) number));

  private Messages() {}

  private static Gson gson(DoubleFunction<String> decimals) {
    return new GsonBuilder()
        .disableHtmlEscaping()
        .setObjectToNumberStrategy(ToNumberPolicy.LONG_OR_DOUBLE)
        .registerTypeAdapter(Double.class, new NumberWriter(decimals))
        .create();
  }

  /** Reads a discovery message. */
  public static Discovery readDiscovery(byte[] payload) {
    Fields fields = new Fields(JsonText.read(payload));
    Fields required = fields.object("requirements");
    return new Discovery()
        .withSimulation(fields.text("simulation"))
        .withSimulationHash(fields.text("simulation_hash"))
        .withRequirements(
            new Requirements()
                .withDimensions(required.number("dimensions"))
                .withMaxAgents(maxAgents(required)))
        .withTool(fields.lenient(() -> fields.optionalText("tool")));
  }

  /** Reads a server message. */
  public static Server readServer(byte[] payload) {
    Fields fields = new Fields(JsonText.read(payload));
    return new Server()
        .withServer(fields.id("server"))
        .withSimulationHash(fields.text("simulation_hash"))
        .withSimulations(fields.texts("simulations"))
        .withCapabilities(readCapabilities(fields.object("capabilities")));
  }

  /** Reads a parameters message; the simulation's parameters are its values. */
  public static Parameters readParameters(byte[] payload) {
    JsonObject object = JsonText.read(payload);
    Fields fields = new Fields(object);
    Parameters parameters =
        new Parameters()
            .withServer(fields.id("server"))
            .withSimulationHash(fields.text("simulation_hash"));
    for (Map.Entry<String, JsonElement> entry : object.entrySet()) {
      if (!ADDRESS.contains(entry.getKey())) {
        checkNumbers(entry.getKey(), entry.getValue());
        parameters.getValues().put(entry.getKey(), GSON.fromJson(entry.getValue(), Object.class));
      }
    }
    return parameters;
  }

  /** The simulation's parameters of a parameters message, as JSON. */
  public static JsonObject problem(Parameters parameters) {
    return GSON.toJsonTree(
            parameters.getValues(), new TypeToken<Map<String, Object>>() {}.getType())
        .getAsJsonObject();
  }

  /** Whether a payload begins like a JSON object, and not like a MessagePack map. */
  public static boolean isObject(byte[] payload) {
    int start = 0;
    while (start < payload.length && " \t\r\n".indexOf(payload[start]) >= 0) {
      start++;
    }
    return start < payload.length && payload[start] == '{';
  }

  /** Reads a control message. */
  public static Control readControl(byte[] payload) {
    Fields fields = new Fields(JsonText.read(payload));
    Boolean run = fields.optionalFlag("run");
    Boolean visual = fields.optionalFlag("visual");
    return new Control()
        .withServer(fields.id("server"))
        .withSimulation(fields.optionalText("simulation"))
        .withSimulationHash(fields.text("simulation_hash"))
        .withRun(run == null || run)
        .withVisual(visual != null && visual)
        .withTool(fields.lenient(() -> fields.optionalText("tool")))
        .withReply(fields.lenient(() -> fields.optionalText("reply")))
        .withInstance(fields.lenient(() -> fields.optionalText("instance")))
        .withScenes(fields.lenient(() -> fields.optionalTexts("scenes")));
  }

  /**
   * Reads a sensor message; its numbers are those binary32 that are nearest to the decimals sent.
   */
  public static Sensor readSensor(byte[] payload) {
    Fields fields = new Fields(JsonText.read(payload));
    return new Sensor()
        .withSimulation(fields.optionalText("simulation"))
        .withSimulationHash(fields.text("simulation_hash"))
        .withAgent(fields.id("agent"))
        .withSensor(fields.singles("sensor"));
  }

  /**
   * Reads an actuator message; its numbers are those binary32 that are nearest to the decimals
   * sent.
   */
  public static Actuator readActuator(byte[] payload) {
    Fields fields = new Fields(JsonText.read(payload));
    return new Actuator()
        .withSimulation(fields.optionalText("simulation"))
        .withSimulationHash(fields.text("simulation_hash"))
        .withAgent(fields.id("agent"))
        .withActuator(fields.singles("actuator"));
  }

  /** Reads a fitness message. */
  public static Fitness readFitness(byte[] payload) {
    Fields fields = new Fields(JsonText.read(payload));
    return new Fitness()
        .withSimulation(fields.optionalText("simulation"))
        .withSimulationHash(fields.text("simulation_hash"))
        .withFitness(fields.number("fitness"))
        .withMetrics(fields.numbers("metrics"));
  }

  /** Reads a presence message (an extension). */
  public static Presence readPresence(byte[] payload) {
    return Presence.read(new Fields(JsonText.read(payload)));
  }

  /**
   * The payload of any of these messages; null fields are omitted.
   *
   * @throws MessageException if a number is not finite
   */
  public static byte[] write(Object message) {
    String text;
    if (message instanceof Parameters) {
      JsonObject object = GSON.toJsonTree(message).getAsJsonObject();
      problem((Parameters) message)
          .entrySet()
          .forEach(entry -> object.add(entry.getKey(), entry.getValue()));
      text = GSON.toJson(object);
    } else if (message instanceof Sensor || message instanceof Actuator) {
      text = SINGLES.toJson(message);
    } else {
      text = GSON.toJson(message);
    }
    return text.getBytes(StandardCharsets.UTF_8);
  }

  /** The capabilities in a server or presence message. */
  static Capabilities readCapabilities(Fields fields) {
    return new Capabilities()
        .withDimensions(fields.number("dimensions"))
        .withMaxAgents(maxAgents(fields))
        .withSwarmwright(
            fields.has("swarmwright") ? fields.lenient(() -> announcement(fields)) : null);
  }

  private static List<Module> modules(Fields fields) {
    List<Fields> modules = fields.optionalObjects("modules");
    if (modules == null) {
      return null;
    }
    List<Module> result = new ArrayList<>(modules.size());
    for (Fields module : modules) {
      result.add(
          new Module()
              .withRole(module.text("role"))
              .withName(module.text("name"))
              .withFile(module.optionalText("file"))
              .withSha256(module.optionalText("sha256")));
    }
    return result;
  }

  private static List<Side> sides(Fields fields) {
    List<Fields> sides = fields.optionalObjects("sides");
    if (sides == null) {
      return null;
    }
    List<Side> result = new ArrayList<>(sides.size());
    Set<String> names = new HashSet<>();
    Set<String> groups = new HashSet<>();
    for (Fields fieldsOfSide : sides) {
      Side side =
          new Side()
              .withName(fieldsOfSide.text("name"))
              .withGroups(fieldsOfSide.texts("groups"))
              .withFitness(fieldsOfSide.optionalText("fitness"));
      boolean isValid =
          isName(side.getName())
              && side.getGroups().size() <= MOST_SIDES
              && side.getGroups().stream().allMatch(Messages::isName)
              && (side.getFitness() == null || isName(side.getFitness()));
      boolean isNew = names.add(side.getName()) && side.getGroups().stream().allMatch(groups::add);
      if (!isValid || !isNew) {
        throw new MessageException("\"sides\" are not sides of a match");
      }
      result.add(side);
    }
    if (result.size() > MOST_SIDES) {
      throw new MessageException("\"sides\" are too many");
    }
    return result;
  }

  private static boolean isName(String text) {
    int characters = text.codePointCount(0, text.length());
    return characters > 0 && characters <= MOST_NAME;
  }

  private static Swarmwright announcement(Fields capabilities) {
    Fields fields = capabilities.object("swarmwright");
    return new Swarmwright()
        .withVersion((int) Math.min(fields.id("version"), Integer.MAX_VALUE))
        .withModes(fields.lenient(() -> fields.optionalTexts("modes")))
        .withControllers(fields.lenient(() -> fields.optionalTexts("controllers")))
        .withModules(fields.lenient(() -> modules(fields)))
        .withBatch(count(fields, "batch"))
        .withLanes(count(fields, "lanes"))
        .withDistributions(fields.lenient(() -> fields.optionalTexts("distributions")))
        .withSensors(count(fields, "sensors"))
        .withActuators(count(fields, "actuators"))
        .withMetrics(fields.lenient(() -> fields.optionalTexts("metrics")))
        .withSides(fields.lenient(() -> sides(fields)))
        .withDeterminism(fields.lenient(() -> determinism(fields)))
        .withTolerance(
            fields.has("tolerance") ? fields.lenient(() -> fields.number("tolerance")) : null)
        .withScenes(fields.lenient(() -> fields.optionalFlag("scenes")))
        .withControl(fields.lenient(() -> fields.optionalFlag("control")))
        .withInstance(fields.lenient(() -> fields.optionalText("instance")))
        .withHost(fields.lenient(() -> fields.optionalText("host")))
        .withPid(count(fields, "pid"));
  }

  private static Swarmwright.Determinism determinism(Fields fields) {
    String name = fields.optionalText("determinism");
    return name == null ? null : Swarmwright.Determinism.fromValue(name);
  }

  private static Integer count(Fields fields, String key) {
    return fields.has(key)
        ? fields.lenient(() -> (int) Math.min(fields.id(key), Integer.MAX_VALUE))
        : null;
  }

  /**
   * Also in the spelling of the published server schema; where both are present max_agents counts.
   */
  private static Double maxAgents(Fields fields) {
    Double published = fields.optionalNumber("max agents");
    Double number = fields.optionalNumber("max_agents");
    return number == null ? published : number;
  }

  private static void checkNumbers(String name, JsonElement value) {
    if (value.isJsonObject()) {
      value.getAsJsonObject().entrySet().forEach(entry -> checkNumbers(name, entry.getValue()));
    } else if (value.isJsonArray()) {
      value.getAsJsonArray().forEach(item -> checkNumbers(name, item));
    } else if (value.isJsonPrimitive() && value.getAsJsonPrimitive().isNumber()) {
      if (!Double.isFinite(value.getAsDouble())) {
        throw new MessageException("\"" + name + "\" has a number beyond binary64");
      }
    }
  }
}
