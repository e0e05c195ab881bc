package org.swarmwright.extension;

import org.swarmwright.messages.MessageException;

/**
 * A message from an optimization tool to one server: {@link Evaluate}, {@link BatchStart} or {@link
 * BatchActuators}.
 */
public interface ToServer {
  /** Number of the request. */
  long request();

  /**
   * Reads a payload.
   *
   * @throws MessageException if it is too large, not a MessagePack map of a known kind and version,
   *     or a field is missing or wrong
   */
  static ToServer read(byte[] payload) {
    MapReader map = MapReader.of(payload);
    String kind = map.text("kind");
    if (map.count("version", Long.MAX_VALUE) != 1) {
      throw new MessageException(
          "\"version\" is " + map.count("version", Long.MAX_VALUE) + ", expected 1");
    }
    switch (kind) {
      case "evaluate":
        return new Evaluate(map);
      case "start":
        return new BatchStart(map);
      case "actuators":
        return new BatchActuators(map);
      default:
        throw new MessageException(
            "\"kind\" is \"" + kind + "\", expected evaluate, start or actuators");
    }
  }
}
