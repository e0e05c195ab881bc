package org.swarmwright.messages;

import com.google.gson.annotations.SerializedName;
import java.util.List;

/** A server's retained message (an extension): what it offers, and whether it is free. */
public final class Presence {
  /** What a server does. */
  public enum State {
    /** It answers discovery. */
    @SerializedName("ready")
    READY,
    /** An optimization tool has it. */
    @SerializedName("busy")
    BUSY,
    /** Its connection broke: the last will. */
    @SerializedName("lost")
    LOST
  }

  private final int version = 1;
  private final long server;
  private final State state;
  private final List<String> simulations;
  private final Capabilities capabilities;
  private final String tool;
  private final String since;
  private final String host;
  private final Integer pid;
  private final String instance;

  /**
   * Makes the message.
   *
   * @param tool the tool that has the server; null if none, or an unnamed one, has it
   * @param since when the state began, RFC 3339
   */
  public Presence(
      long server,
      State state,
      List<String> simulations,
      Capabilities capabilities,
      String tool,
      String since) {
    Swarmwright announced = capabilities.getSwarmwright();
    this.server = server;
    this.state = state;
    this.simulations = List.copyOf(simulations);
    this.capabilities = capabilities;
    this.tool = tool;
    this.since = since;
    this.host = announced == null ? null : announced.getHost();
    this.pid = announced == null ? null : announced.getPid();
    this.instance = announced == null ? null : announced.getInstance();
  }

  static Presence read(Fields fields) {
    if (fields.id("version") != 1) {
      throw new MessageException("\"version\" is " + fields.id("version") + ", expected 1");
    }
    checkProcess(fields);
    return new Presence(
        fields.id("server"),
        readState(fields.text("state")),
        fields.texts("simulations"),
        Messages.readCapabilities(fields.object("capabilities")),
        fields.optionalText("tool"),
        fields.text("since"));
  }

  /** Checks the copies of host, process ID and instance; they are read from the capabilities. */
  private static void checkProcess(Fields fields) {
    fields.optionalText("host");
    fields.optionalText("instance");
    if (fields.has("pid")) {
      fields.id("pid");
    }
  }

  private static State readState(String name) {
    switch (name) {
      case "ready":
        return State.READY;
      case "busy":
        return State.BUSY;
      case "lost":
        return State.LOST;
      default:
        throw new MessageException("\"state\" is \"" + name + "\", expected ready, busy or lost");
    }
  }

  /** ID of the server. */
  public long getServer() {
    return server;
  }

  /** What it does. */
  public State getState() {
    return state;
  }

  /** Titles of the simulations that it offers. */
  public List<String> getSimulations() {
    return simulations;
  }

  /** What it can do. */
  public Capabilities getCapabilities() {
    return capabilities;
  }

  /** The tool that has it; null if none, or an unnamed one, has it. */
  public String getTool() {
    return tool;
  }

  /** When the state began, RFC 3339. */
  public String getSince() {
    return since;
  }
}
