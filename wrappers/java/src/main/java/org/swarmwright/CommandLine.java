package org.swarmwright;

import java.util.ArrayDeque;
import java.util.Deque;
import java.util.List;
import java.util.concurrent.CompletableFuture;
import java.util.concurrent.ExecutionException;
import java.util.concurrent.TimeUnit;
import java.util.concurrent.TimeoutException;
import java.util.function.Supplier;

/** The command-line arguments of a server. */
public final class CommandLine {
  private static final String USAGE =
      "usage: [--broker URL] [--id NUMBER] [--prefix PREFIX] [--step-timeout SECONDS]\n"
          + "  --broker        mqtt://HOST:PORT, mqtts://, ws:// or wss://;\n"
          + "                  SWARMWRIGHT_BROKER, else mqtt://localhost:1883\n"
          + "  --id            the server's ID, from 0, unique on the broker; 1 by default\n"
          + "  --prefix        prefix of all topics, \"\" for none; SWARMWRIGHT_PREFIX, else none\n"
          + "  --step-timeout  how long a step waits for actuators before it is given up; 60 by"
          + " default";

  /** URL of the broker; that of the environment, SWARMWRIGHT_BROKER, where none is given. */
  public String broker = Defaults.broker();

  /** ID of the server. */
  public long id = 1;

  /** Topic prefix; that of the environment, SWARMWRIGHT_PREFIX, where none is given. */
  public String prefix = Defaults.prefix();

  /** Seconds that a step waits for actuators. */
  public double stepTimeout = 60;

  /**
   * Reads arguments.
   *
   * @throws IllegalArgumentException if one is unknown, or its value is missing or not valid
   */
  public CommandLine(List<String> arguments) {
    Deque<String> rest = new ArrayDeque<>();
    for (String argument : arguments) {
      int equals = argument.startsWith("--") ? argument.indexOf('=') : -1;
      if (equals > 0) {
        rest.add(argument.substring(0, equals));
        rest.add(argument.substring(equals + 1));
      } else {
        rest.add(argument);
      }
    }
    while (!rest.isEmpty()) {
      String name = rest.remove();
      if (!List.of("--broker", "--id", "--prefix", "--step-timeout").contains(name)) {
        throw new IllegalArgumentException(name + ": unknown\n" + USAGE);
      }
      if (rest.isEmpty()) {
        throw new IllegalArgumentException(name + ": expected a value after it");
      }
      set(name, rest.remove());
    }
  }

  private void set(String name, String value) {
    try {
      switch (name) {
        case "--broker":
          broker = value;
          break;
        case "--id":
          id = Long.parseLong(value);
          break;
        case "--prefix":
          prefix = value;
          break;
        default:
          stepTimeout = Double.parseDouble(value);
          break;
      }
    } catch (NumberFormatException error) {
      throw new IllegalArgumentException(name + ": \"" + value + "\" is not a number");
    }
  }

  static void serve(String[] arguments, Supplier<? extends Simulation> maker) {
    run(
        arguments,
        options ->
            SimulationServer.offering(maker)
                .broker(options.broker)
                .id(options.id)
                .prefix(options.prefix)
                .stepTimeout(options.stepTimeout)
                .start());
  }

  /** What is started from the arguments, and closed when the program is terminated. */
  public interface Program {
    /** Starts it. */
    AutoCloseable start(CommandLine options);
  }

  /** Starts a server, which runs in other threads; errors become a line and an exit status. */
  public static void run(String[] arguments, Program program) {
    if (List.of(arguments).contains("--help")) {
      System.out.println(USAGE);
      return;
    }
    CompletableFuture<AutoCloseable> started = new CompletableFuture<>();
    // Before the start, so that a program terminated while it starts closes its server, too.
    Runtime.getRuntime().addShutdownHook(new Thread(() -> leave(started)));
    try {
      AutoCloseable server = program.start(new CommandLine(List.of(arguments)));
      started.complete(server);
      if (server instanceof SimulationServer) {
        ((SimulationServer) server).await();
      }
      Thread.currentThread().join();
    } catch (InterruptedException error) {
      Thread.currentThread().interrupt();
    } catch (IllegalArgumentException error) {
      fail(2, error, started);
    } catch (BrokerException | IllegalStateException error) {
      fail(1, error, started);
    }
  }

  private static void fail(
      int status, RuntimeException error, CompletableFuture<AutoCloseable> started) {
    System.err.println("error: " + error.getMessage());
    started.completeExceptionally(error);
    System.exit(status);
  }

  private static void leave(CompletableFuture<AutoCloseable> started) {
    try {
      started.get(10, TimeUnit.SECONDS).close();
    } catch (ExecutionException | TimeoutException error) {
      // It has not started.
      return;
    } catch (Exception error) {
      System.err.println("leaving: " + error);
    }
  }
}
