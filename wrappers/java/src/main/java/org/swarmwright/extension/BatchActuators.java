package org.swarmwright.extension;

/**
 * What the agents of the last sensors message do (protocol/schemas/batch_actuators.schema.json).
 */
public final class BatchActuators implements ToServer {
  /** The batch. */
  public final long request;

  /** The step of the sensors that are answered. */
  public final long step;

  /** (rows of the sensors, actuators), row-major, finite; none to end the batch. */
  public final float[] actuators;

  BatchActuators(MapReader map) {
    request = map.bits("request");
    step = map.bits("step");
    actuators = map.singles("actuators");
  }

  @Override
  public long request() {
    return request;
  }
}
