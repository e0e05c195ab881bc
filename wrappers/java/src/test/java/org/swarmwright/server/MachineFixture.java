package org.swarmwright.server;

import static org.junit.jupiter.api.Assertions.assertEquals;

import java.io.IOException;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.nio.charset.StandardCharsets;
import java.util.ArrayList;
import java.util.List;
import org.msgpack.core.MessageBufferPacker;
import org.msgpack.core.MessagePack;
import org.msgpack.value.MapValue;
import org.msgpack.value.Value;
import org.msgpack.value.ValueFactory;
import org.swarmwright.Walk;
import org.swarmwright.messages.Topics;
import org.swarmwright.messages.Topics.Topic;

/** A server's decisions without a broker, and what is said to it: time is what the test says. */
abstract class MachineFixture {
  static final long SECOND = 1_000_000_000L;

  /** Keeps what the machine wants done. */
  static final class Recorder implements Outbox {
    final List<String> published = new ArrayList<>();
    final List<MapValue> replies = new ArrayList<>();
    final List<Job> jobs = new ArrayList<>();
    final List<String> notices = new ArrayList<>();
    final List<String> rivals = new ArrayList<>();

    /** Bytes of messages and of answers that the broker takes. */
    int most = Integer.MAX_VALUE;

    int mostOfAnswers = Integer.MAX_VALUE;

    private static void check(String label, byte[] payload, int most) {
      if (payload.length > most) {
        throw new TooLarge(label, payload.length, most);
      }
    }

    @Override
    public void publish(Topic topic, byte[] payload) {
      check("a " + topic.text() + " message", payload, most);
      published.add(topic.text() + " " + new String(payload, StandardCharsets.UTF_8));
    }

    @Override
    public void presence(byte[] payload) {
      published.add("presence");
    }

    @Override
    public void reply(String topic, Long request, byte[] payload) {
      assertEquals("swarmwright/v1/tool/t", topic);
      check("its answer", payload, mostOfAnswers);
      try {
        replies.add(MessagePack.newDefaultUnpacker(payload).unpackValue().asMapValue());
      } catch (IOException error) {
        throw new AssertionError(error);
      }
    }

    @Override
    public void evaluate(Job job) {
      jobs.add(job);
    }

    @Override
    public void notice(String text) {
      notices.add(text);
    }

    @Override
    public void giveWay(String rival) {
      rivals.add(rival);
    }

    @Override
    public void show(String picture) {
      published.add("picture");
    }

    Value last(String key) {
      return replies.get(replies.size() - 1).map().get(ValueFactory.newString(key));
    }

    String error() {
      return String.valueOf(last("error"));
    }
  }

  final Recorder out = new Recorder();
  final Identity identity = new Identity(7);
  final Machine machine = new Machine(identity, Offer.of(Walk::new), new Topics(""), 60, out);
  long now;

  void say(String topic, String fields) {
    byte[] payload = ("{" + fields.replace('\'', '"') + "}").getBytes(StandardCharsets.UTF_8);
    machine.receive(topic, payload, false, now);
  }

  boolean isFree(String asker) {
    int before = out.published.size();
    say(
        "discovery",
        "'simulation': 'walk', 'simulation_hash': 'd', 'requirements': {'dimensions': 2}" + asker);
    return out.published.size() > before;
  }

  long sensors() {
    return out.published.stream().filter(said -> said.startsWith("sensor")).count();
  }

  static byte[] floats(float... numbers) {
    ByteBuffer bytes = ByteBuffer.allocate(4 * numbers.length).order(ByteOrder.LITTLE_ENDIAN);
    bytes.asFloatBuffer().put(numbers);
    return bytes.array();
  }

  static byte[] longs(long... numbers) {
    ByteBuffer bytes = ByteBuffer.allocate(8 * numbers.length).order(ByteOrder.LITTLE_ENDIAN);
    bytes.asLongBuffer().put(numbers);
    return bytes.array();
  }

  static double[] doubles(Value binary) {
    ByteBuffer bytes = binary.asBinaryValue().asByteBuffer().order(ByteOrder.LITTLE_ENDIAN);
    double[] numbers = new double[bytes.remaining() / 8];
    bytes.asDoubleBuffer().get(numbers);
    return numbers;
  }

  /** A request with a linear controller: the actuator is the weight of the bias plus the other. */
  void evaluate(long request, String tool, double lease, long... seeds) throws IOException {
    evaluate(request, tool, lease, "half", floats(0f, 0.25f, 0f, 0.5f), seeds);
  }

  /** A null metric: none is wanted. */
  void evaluate(
      long request, String tool, double lease, String metric, byte[] genomes, long... seeds)
      throws IOException {
    MessageBufferPacker packer = MessagePack.newDefaultBufferPacker();
    packer.packMapHeader(13);
    packer.packString("kind").packString("evaluate").packString("version").packInt(1);
    packer.packString("request").packLong(request).packString("tool").packString(tool);
    packer.packString("reply").packString("swarmwright/v1/tool/t");
    packer.packString("simulation").packString("walk").packString("parameters").packMapHeader(0);
    packer.packString("controller").packMapHeader(7);
    packer.packString("version").packInt(1).packString("kind").packString("layered");
    packer.packString("sensors").packInt(1).packString("actuators").packInt(1);
    packer.packString("hidden").packArrayHeader(0);
    packer.packString("activation").packString("linear");
    packer.packString("output_range").packArrayHeader(2).packInt(-1).packInt(1);
    packer.packString("genomes").packBinaryHeader(genomes.length).writePayload(genomes);
    byte[] bytes = longs(seeds);
    packer.packString("seeds").packBinaryHeader(bytes.length).writePayload(bytes);
    packer.packString("metrics").packArrayHeader(metric == null ? 0 : 1);
    if (metric != null) {
      packer.packString(metric);
    }
    packer.packString("lease").packDouble(lease);
    packer.packString("attempt").packInt(1);
    machine.receive("swarmwright/v1/server/7", packer.toByteArray(), false, now);
  }

  void work() {
    Job job = out.jobs.remove(0);
    job.run();
    machine.finished(job, now);
  }

  void startAndStep(String hash, String parameters, String control) {
    say("parameters", "'server': 7, 'simulation_hash': '" + hash + "'" + parameters);
    say("control", "'server': 7, 'simulation_hash': '" + hash + "'" + control);
    say("actuator", "'simulation_hash': '" + hash + "', 'agent': 0, 'actuator': [0]");
    say("actuator", "'simulation_hash': '" + hash + "', 'agent': 0, 'actuator': [0]");
  }
}
