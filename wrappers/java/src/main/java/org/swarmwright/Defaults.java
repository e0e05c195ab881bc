package org.swarmwright;

import java.util.Map;

/** The broker and the topic prefix of servers that name none: those of the environment. */
final class Defaults {
  static final String BROKER = "SWARMWRIGHT_BROKER";
  static final String PREFIX = "SWARMWRIGHT_PREFIX";
  static final String BROKER_PROPERTY = "swarmwright.broker";

  private static final String LOCAL_BROKER = "mqtt://localhost:1883";

  private Defaults() {}

  /** The system property, else the variable of the environment, else a broker on this machine. */
  static String broker() {
    return System.getProperty(BROKER_PROPERTY, broker(System.getenv()));
  }

  static String broker(Map<String, String> environment) {
    String url = environment.getOrDefault(BROKER, "");
    return url.isEmpty() ? LOCAL_BROKER : url;
  }

  /** Empty where the environment names none. */
  static String prefix() {
    return prefix(System.getenv());
  }

  static String prefix(Map<String, String> environment) {
    return environment.getOrDefault(PREFIX, "");
  }
}
