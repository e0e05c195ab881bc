package org.swarmwright.messages;

import java.util.LinkedHashMap;
import java.util.Map;

/**
 * The simulation's parameters in a parameters message, which are at the same level as the server's
 * ID and the hash.
 */
public class ParameterValues {
  private final transient Map<String, Object> values = new LinkedHashMap<>();

  /**
   * Values by name: Long for whole numbers, Double for others, String, Boolean, List, Map, or null;
   * may be changed.
   */
  public Map<String, Object> getValues() {
    return values;
  }

  /** One value; null if the message does not have it. */
  public Object getValue(String name) {
    return values.get(name);
  }
}
