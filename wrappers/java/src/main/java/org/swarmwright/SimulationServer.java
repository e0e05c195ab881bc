package org.swarmwright;

import java.util.Objects;
import java.util.function.Consumer;
import java.util.function.Supplier;
import org.swarmwright.server.Host;

/**
 * Offers a simulation to optimization tools, over MQTT, with all modes and messages of the
 * protocol.
 *
 * <pre>{@code
 * try (SimulationServer server = SimulationServer.offering(MySimulation::new).broker("mqtt://localhost:1883").id(5).start()) {
 *   server.await();
 * }
 * }</pre>
 *
 * <p>{@link #main} does the same from a command line.
 */
public final class SimulationServer implements AutoCloseable {
  private final Host host;

  private SimulationServer(Host host) {
    this.host = host;
  }

  /** Offers simulations of one kind; one is made for each episode that runs in parallel. */
  public static Options offering(Supplier<? extends Simulation> maker) {
    return new Options(null, Objects.requireNonNull(maker, "maker"));
  }

  /** Offers a simulation of which there can be only one, as when it drives another program. */
  public static Options offering(Simulation only) {
    return new Options(Objects.requireNonNull(only, "only"), null);
  }

  /**
   * The main method of a server: reads {@code --broker}, {@code --id}, {@code --prefix} and {@code
   * --step-timeout}, serves until it is terminated.
   *
   * <p>Exit status: 1 if there is no broker or another server has the ID, 2 if arguments are wrong.
   */
  public static void main(String[] arguments, Supplier<? extends Simulation> maker) {
    CommandLine.serve(arguments, maker);
  }

  /**
   * Waits until the server is closed.
   *
   * @throws IllegalStateException if it has left by itself: another server got its ID while it was
   *     disconnected
   */
  public void await() throws InterruptedException {
    host.await();
  }

  /**
   * Gives up what is under way, removes the presence and disconnects. Waits up to 5 s for a step
   * under way.
   */
  @Override
  public void close() {
    host.close();
  }

  /** Settings of a server. */
  public static final class Options {
    private final Simulation only;
    private final Supplier<? extends Simulation> maker;
    private String broker = Defaults.broker();
    private String prefix = Defaults.prefix();
    private long id = 1;
    private double stepTimeout = 60;
    private Consumer<String> notices = text -> System.err.println(text);
    private Consumer<String> pictures = text -> System.out.println(text);

    private Options(Simulation only, Supplier<? extends Simulation> maker) {
      this.only = only;
      this.maker = maker;
    }

    /**
     * URL of the broker: mqtt://, mqtts://, ws:// or wss://. By default that of the system property
     * {@code swarmwright.broker}, else of the environment, SWARMWRIGHT_BROKER, else
     * mqtt://localhost:1883.
     */
    public Options broker(String url) {
      broker = Objects.requireNonNull(url, "url");
      return this;
    }

    /** ID of the server, from 0, which no other server on the broker has; 1 by default. */
    public Options id(long number) {
      id = number;
      return this;
    }

    /**
     * Topic prefix; empty for none. By default that of the environment, SWARMWRIGHT_PREFIX, else
     * none.
     */
    public Options prefix(String text) {
      prefix = Objects.requireNonNull(text, "text");
      return this;
    }

    /** Seconds that a step waits for actuators before it is given up; 60 by default. */
    public Options stepTimeout(double seconds) {
      if (!(seconds > 0)) {
        throw new IllegalArgumentException(
            "the step time-out is " + seconds + " s; it must be more than 0");
      }
      stepTimeout = seconds;
      return this;
    }

    /** Receives messages for the operator, a text at a time; standard error by default. */
    public Options notices(Consumer<String> listener) {
      notices = Objects.requireNonNull(listener, "listener");
      return this;
    }

    /** Receives the pictures of episodes that are to be shown; standard output by default. */
    public Options pictures(Consumer<String> listener) {
      pictures = Objects.requireNonNull(listener, "listener");
      return this;
    }

    /**
     * Connects and serves, in background threads.
     *
     * @throws BrokerException if the broker cannot be reached
     * @throws IllegalStateException if another server uses the ID
     * @throws IllegalArgumentException if the URL, the prefix or the ID cannot be used
     */
    public SimulationServer start() {
      return new SimulationServer(
          new Host(only, maker, broker, prefix, id, stepTimeout, notices, pictures));
    }
  }
}
