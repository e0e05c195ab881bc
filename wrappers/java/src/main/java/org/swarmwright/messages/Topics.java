package org.swarmwright.messages;

import java.nio.charset.StandardCharsets;

/** Names of the topics under one prefix. */
public final class Topics {
  /** The topics of the protocol. */
  public enum Topic {
    /** Asks which servers are available. */
    DISCOVERY("discovery"),
    /** A server's answer. */
    SERVER("server"),
    /** Parameters of a simulation. */
    PARAMETERS("parameters"),
    /** Start or end of an episode. */
    CONTROL("control"),
    /** The sensors of an agent. */
    SENSOR("sensor"),
    /** The actuators of an agent. */
    ACTUATOR("actuator"),
    /** The end of an episode. */
    FITNESS("fitness"),
    /** What a server does now, retained (an extension). */
    PRESENCE("swarmwright/v1/presence"),
    /** Requests to one server (an extension). */
    TO_SERVER("swarmwright/v1/server"),
    /** Answers to one tool (an extension). */
    TO_TOOL("swarmwright/v1/tool"),
    /** What one tool does now, for monitoring (an extension). */
    STATUS("swarmwright/v1/status");

    private final String text;

    Topic(String text) {
      this.text = text;
    }

    /** The name without prefix; of an extension's topic without the last level. */
    public String text() {
      return text;
    }
  }

  private static final int MAX_PREFIX = 1000;

  private final String prefix;

  /**
   * Topics under a prefix.
   *
   * @param prefix put before every topic, with a slash between; empty for none
   * @throws IllegalArgumentException if it has a wildcard or NUL, begins with / or $, or has more
   *     than 1,000 bytes
   */
  public Topics(String prefix) {
    String bare = prefix.endsWith("/") ? prefix.substring(0, prefix.length() - 1) : prefix;
    String wrong = null;
    if (bare.chars().anyMatch(c -> c == '+' || c == '#' || c == 0)) {
      wrong = "+, # and NUL have a special meaning in MQTT; use letters, digits, - and /";
    } else if (bare.startsWith("/") || bare.startsWith("$") || prefix.equals("/")) {
      wrong = "must not begin with / or $";
    } else if (bare.getBytes(StandardCharsets.UTF_8).length > MAX_PREFIX) {
      wrong = "is longer than 1,000 bytes";
    }
    if (wrong != null) {
      throw new IllegalArgumentException("topic prefix \"" + bare + "\": " + wrong);
    }
    this.prefix = bare.isEmpty() ? "" : bare + "/";
  }

  /** The full name of one of the seven topics. */
  public String name(Topic topic) {
    return prefix + topic.text;
  }

  /** The topic of one server: its presence, or the requests to it. */
  public String name(Topic topic, long server) {
    return prefix + topic.text + "/" + server;
  }

  /** The full name of a topic that a message gives without prefix. */
  public String under(String name) {
    return prefix + name;
  }

  /** The topic with a full name; null if it is not one of the protocol. */
  public Topic parse(String name) {
    if (!name.startsWith(prefix)) {
      return null;
    }
    String bare = name.substring(prefix.length());
    for (Topic topic : Topic.values()) {
      if (topic.ordinal() < Topic.PRESENCE.ordinal()) {
        if (bare.equals(topic.text)) {
          return topic;
        }
      } else if (bare.startsWith(topic.text + "/")) {
        String last = bare.substring(topic.text.length() + 1);
        boolean fits =
            topic == Topic.TO_TOOL || topic == Topic.STATUS
                ? !last.isEmpty() && last.indexOf('/') < 0
                : last.matches("[0-9]{1,19}");
        return fits ? topic : null;
      }
    }
    return null;
  }
}
