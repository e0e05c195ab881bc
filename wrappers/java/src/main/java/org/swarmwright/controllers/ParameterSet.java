package org.swarmwright.controllers;

import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import com.google.gson.JsonPrimitive;
import java.util.List;
import org.swarmwright.messages.Decimals;

/**
 * Values of parameters of a simulation that steers its agents itself, a weight for each, instead of
 * a controller.
 */
public final class ParameterSet extends Architecture {
  /** A parameter of the simulation. */
  static final class Parameter {
    private final String name;
    private final String type;
    private final List<String> choices;

    Parameter(String name, String type, List<String> choices) {
      this.name = name;
      this.type = type;
      this.choices = choices;
    }

    private JsonElement value(float weight) {
      switch (type) {
        case "real":
          // Through its decimal, so that 0.1 is 0.1 and not 0.10000000149011612.
          return new JsonPrimitive(Double.parseDouble(Decimals.shortest(weight)));
        case "integer":
          return new JsonPrimitive((long) Math.floor(weight));
        default:
          return new JsonPrimitive(
              choices.get(Math.min((int) Math.max(weight, 0f), choices.size() - 1)));
      }
    }
  }

  private final List<Parameter> parameters;

  private ParameterSet(List<Parameter> parameters) {
    super(0, 0);
    this.parameters = parameters;
  }

  static ParameterSet read(SpecificationReader reader) {
    return new ParameterSet(reader.parameters(MAX_WEIGHTS));
  }

  /** The parameters of an episode: those given, overridden by the values of this set. */
  public JsonObject merged(JsonObject values, float[] weights, int first) {
    JsonObject merged = new JsonObject();
    values.entrySet().forEach(entry -> merged.add(entry.getKey(), entry.getValue()));
    for (int i = 0; i < parameters.size(); i++) {
      merged.add(parameters.get(i).name, parameters.get(i).value(weights[first + i]));
    }
    return merged;
  }

  @Override
  public boolean steers() {
    return false;
  }

  @Override
  public long weightCount() {
    return parameters.size();
  }

  @Override
  int stateLength() {
    return 0;
  }

  @Override
  void step(
      float[] weights,
      int first,
      float[] state,
      float[] scratch,
      float[] sensors,
      float[] actuators) {
    throw new UnsupportedOperationException("a parameter set steers no agents");
  }
}
