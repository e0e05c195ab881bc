package org.swarmwright.extension;

import java.io.IOException;
import java.io.UncheckedIOException;
import java.math.BigInteger;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.util.List;
import java.util.Locale;
import java.util.Map;
import java.util.TreeMap;
import org.msgpack.core.MessageBufferPacker;
import org.msgpack.core.MessagePack;
import org.msgpack.core.MessagePacker;

/** Writes the messages from a server to a tool, in their canonical form. */
public final class Answers {
  private Answers() {}

  /**
   * The result of an offloaded evaluation (protocol/schemas/evaluated.schema.json).
   *
   * @param fitness (candidates, episodes), row-major; NaN where {@code failed} says why
   * @param metrics by name, each of the shape of the fitness
   * @param error why nothing was evaluated, else null
   * @param seconds of computation
   */
  public static byte[] evaluated(
      long request,
      long server,
      double[] fitness,
      Map<String, double[]> metrics,
      List<Failure> failed,
      Refusal error,
      double seconds) {
    return pack(
        packer -> {
          packer.packMapHeader(
              6 + one(!metrics.isEmpty()) + one(!failed.isEmpty()) + one(error != null));
          head(packer, "evaluated", request, server);
          packer.packString("fitness");
          doubles(packer, fitness);
          if (!metrics.isEmpty()) {
            packer.packString("metrics").packMapHeader(metrics.size());
            for (Map.Entry<String, double[]> metric : new TreeMap<>(metrics).entrySet()) {
              packer.packString(metric.getKey());
              doubles(packer, metric.getValue());
            }
          }
          tail(packer, failed, error);
          packer.packString("seconds").packDouble(seconds);
        });
  }

  /** A step of a batch (protocol/schemas/batch_sensors.schema.json). */
  public static byte[] sensors(BatchSensors message) {
    return pack(
        packer -> {
          packer.packMapHeader(
              10
                  + one(!message.metrics.isEmpty())
                  + one(!message.failed.isEmpty())
                  + one(message.error != null));
          head(packer, "sensors", message.request, message.server);
          packer.packString("step");
          unsigned(packer, message.step);
          binary(packer.packString("episodes"), message.episodes.bytes());
          binary(packer.packString("agents"), message.agents.bytes());
          binary(packer.packString("sensors"), message.sensors.bytes());
          binary(packer.packString("ended"), message.ended.bytes());
          binary(packer.packString("fitness"), message.fitness.bytes());
          if (!message.metrics.isEmpty()) {
            packer.packString("metrics").packMapHeader(message.metrics.size());
            for (Map.Entry<String, Block> metric : message.metrics.entrySet()) {
              binary(packer.packString(metric.getKey()), metric.getValue().bytes());
            }
          }
          tail(packer, message.failed, message.error);
        });
  }

  /** The failure of a stepwise episode (protocol/schemas/failed.schema.json). */
  public static byte[] failed(Failed message) {
    return pack(
        packer -> {
          packer.packMapHeader(5 + one(message.stack != null) + one(message.invalid));
          packer.packString("kind").packString("failed").packString("version").packInt(1);
          packer.packString("server").packLong(message.server);
          packer.packString("simulation_hash").packString(message.simulationHash);
          packer.packString("reason").packString(message.reason);
          stack(packer, message.stack);
          if (message.invalid) {
            packer.packString("invalid").packBoolean(true);
          }
        });
  }

  private static void stack(MessagePacker packer, String stack) throws IOException {
    if (stack != null) {
      packer.packString("stack").packString(stack);
    }
  }

  private interface Content {
    void pack(MessagePacker packer) throws IOException;
  }

  private static byte[] pack(Content content) {
    try (MessageBufferPacker packer = MessagePack.newDefaultBufferPacker()) {
      content.pack(packer);
      return packer.toByteArray();
    } catch (IOException error) {
      throw new UncheckedIOException("writing into memory", error);
    }
  }

  private static int one(boolean condition) {
    return condition ? 1 : 0;
  }

  private static void head(MessagePacker packer, String kind, long request, long server)
      throws IOException {
    packer
        .packString("kind")
        .packString(kind)
        .packString("version")
        .packInt(1)
        .packString("request");
    unsigned(packer, request);
    packer.packString("server").packLong(server);
  }

  private static void tail(MessagePacker packer, List<Failure> failed, Refusal error)
      throws IOException {
    if (!failed.isEmpty()) {
      packer.packString("failed").packArrayHeader(failed.size());
      for (Failure failure : failed) {
        packer.packMapHeader(3 + one(failure.stack != null));
        packer.packString("candidate").packLong(failure.candidate);
        packer
            .packString("episode")
            .packLong(failure.episode)
            .packString("reason")
            .packString(failure.reason);
        stack(packer, failure.stack);
      }
    }
    if (error != null) {
      packer.packString("error").packMapHeader(2);
      packer.packString("kind").packString(error.kind().name().toLowerCase(Locale.ROOT));
      packer.packString("reason").packString(error.getMessage());
    }
  }

  private static void unsigned(MessagePacker packer, long bits) throws IOException {
    if (bits >= 0) {
      packer.packLong(bits);
    } else {
      packer.packBigInteger(new BigInteger(Long.toUnsignedString(bits)));
    }
  }

  private static void binary(MessagePacker packer, byte[] bytes) throws IOException {
    packer.packBinaryHeader(bytes.length).writePayload(bytes);
  }

  private static void doubles(MessagePacker packer, double[] numbers) throws IOException {
    ByteBuffer bytes =
        ByteBuffer.allocate(Double.BYTES * numbers.length).order(ByteOrder.LITTLE_ENDIAN);
    bytes.asDoubleBuffer().put(numbers);
    binary(packer, bytes.array());
  }
}
