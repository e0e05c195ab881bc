package org.swarmwright.extension;

import java.io.IOException;
import java.io.UncheckedIOException;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.util.ArrayList;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
import java.util.TreeMap;
import java.util.function.ToDoubleFunction;
import java.util.function.ToIntFunction;
import org.msgpack.core.MessageBufferPacker;
import org.msgpack.core.MessagePack;
import org.msgpack.core.MessagePacker;
import org.swarmwright.Scene;

/** Writes scenes (protocol/schemas/scene.schema.json). */
public final class SceneWriter {
  private final MessageBufferPacker packer = MessagePack.newDefaultBufferPacker();
  private final Scene scene;

  private SceneWriter(Scene scene) {
    this.scene = scene;
  }

  /** Which episode it is, and what is known of it so far. */
  public static final class Head {
    /** The server's ID. */
    public final long server;

    /** Of the control message that started the episode. */
    public final String hash;

    /** Steps that are done. */
    public final long step;

    /** Fitness so far; null if it is not known. */
    public final Double fitness;

    /** Metrics so far. */
    public final Map<String, Double> metrics;

    /** For how long it is to be seen. */
    public final double seconds;

    /** All of them. */
    public Head(
        long server,
        String hash,
        long step,
        Double fitness,
        Map<String, Double> metrics,
        double seconds) {
      this.server = server;
      this.hash = hash;
      this.step = step;
      this.fitness = fitness;
      this.metrics = new TreeMap<>(metrics);
      this.seconds = seconds;
    }
  }

  /** The message; {@code parts}: which of rays and links the tool asked for. */
  public static byte[] write(Scene scene, Head head, List<String> parts) {
    try {
      return new SceneWriter(scene).written(head, parts);
    } catch (IOException error) {
      throw new UncheckedIOException("writing into memory", error);
    }
  }

  private byte[] written(Head head, List<String> parts) throws IOException {
    boolean rays = parts.contains("rays") && !scene.rays().isEmpty();
    boolean links = parts.contains("links") && !scene.links().isEmpty();
    double[] origin = scene.origin();
    boolean moved = origin[0] != 0 || origin[1] != 0;
    int optional = 0;
    boolean[] present = {
      head.fitness != null,
      !head.metrics.isEmpty(),
      moved,
      scene.isGrid(),
      !scene.message().isEmpty(),
      rays,
      links,
      scene.floor() != null,
      !scene.patches().isEmpty(),
      !scene.walls().isEmpty(),
      !scene.lights().isEmpty(),
      !scene.styles().isEmpty(),
      scene.scale() != null
    };
    for (boolean flag : present) {
      optional += flag ? 1 : 0;
    }
    packer.packMapHeader(9 + optional);
    head(head);
    packer.packString("width").packFloat((float) scene.width);
    packer.packString("height").packFloat((float) scene.height);
    if (moved) {
      packer.packString("origin").packArrayHeader(2);
      packer.packFloat((float) origin[0]).packFloat((float) origin[1]);
    }
    if (scene.isGrid()) {
      packer.packString("grid").packBoolean(true);
    }
    if (!scene.message().isEmpty()) {
      packer.packString("message").packString(scene.message());
    }
    bodies(scene.bodies());
    if (rays) {
      rays(scene.rays());
    }
    if (links) {
      indices("links", flat(scene.links()));
    }
    world();
    return packer.toByteArray();
  }

  private void head(Head head) throws IOException {
    packer.packString("kind").packString("scene").packString("version").packInt(1);
    packer.packString("server").packLong(head.server);
    packer.packString("simulation_hash").packString(head.hash);
    packer.packString("step").packLong(head.step);
    if (head.fitness != null) {
      packer.packString("fitness").packDouble(head.fitness);
    }
    if (!head.metrics.isEmpty()) {
      packer.packString("metrics").packMapHeader(head.metrics.size());
      for (Map.Entry<String, Double> metric : head.metrics.entrySet()) {
        packer.packString(metric.getKey()).packDouble(metric.getValue());
      }
    }
    packer.packString("seconds").packDouble(head.seconds);
  }

  private void bodies(List<Scene.Body> bodies) throws IOException {
    Map<List<String>, Integer> looks = new LinkedHashMap<>();
    int[] look = new int[bodies.size()];
    for (int i = 0; i < look.length; i++) {
      List<String> words = List.of(bodies.get(i).kind, bodies.get(i).state());
      looks.putIfAbsent(words, looks.size());
      look[i] = looks.get(words);
    }
    boolean heading = bodies.stream().anyMatch(body -> !Double.isNaN(body.heading()));
    boolean value = bodies.stream().anyMatch(body -> !Double.isNaN(body.value()));
    boolean agent = bodies.stream().anyMatch(body -> body.agent() >= 0);
    boolean label = bodies.stream().anyMatch(body -> !body.label().isEmpty());
    int optional = (heading ? 1 : 0) + (value ? 1 : 0) + (agent ? 1 : 0) + (label ? 1 : 0);
    packer.packString("bodies").packMapHeader(5 + optional);
    packer.packString("looks").packArrayHeader(looks.size());
    for (List<String> words : looks.keySet()) {
      packer.packArrayHeader(2).packString(words.get(0)).packString(words.get(1));
    }
    indices("look", look);
    singles("x", bodies, body -> body.x);
    singles("y", bodies, body -> body.y);
    singles("radius", bodies, Scene.Body::radius);
    if (heading) {
      singles("heading", bodies, Scene.Body::heading);
    }
    if (value) {
      singles("value", bodies, Scene.Body::value);
    }
    if (agent) {
      // -1 has the bits of the number that stands for none.
      indices("agent", numbers(bodies, Scene.Body::agent));
    }
    if (label) {
      packer.packString("labels").packArrayHeader(bodies.size());
      for (Scene.Body body : bodies) {
        packer.packString(body.label());
      }
    }
  }

  private void rays(List<Scene.Ray> rays) throws IOException {
    packer.packString("rays").packMapHeader(5);
    indices("body", numbers(rays, ray -> ray.body));
    String[] names = {"angle", "start", "length", "reading"};
    for (int i = 0; i < names.length; i++) {
      int column = i;
      singles(names[i], rays, ray -> ray.numbers[column]);
    }
  }

  private void world() throws IOException {
    if (scene.floor() != null) {
      packer.packString("floor");
      patch(scene.floor());
    }
    if (!scene.patches().isEmpty()) {
      packer.packString("patches").packArrayHeader(scene.patches().size());
      for (Scene.Patch patch : scene.patches()) {
        patch(patch);
      }
    }
    if (!scene.walls().isEmpty()) {
      packer.packString("walls").packArrayHeader(scene.walls().size());
      for (Scene.Wall wall : scene.walls()) {
        packer.packMapHeader(2);
        points(wall.points);
        packer.packString("solid").packBoolean(wall.solid);
      }
    }
    if (!scene.lights().isEmpty()) {
      packer.packString("lights").packArrayHeader(scene.lights().size());
      for (double[] light : scene.lights()) {
        packer.packMapHeader(3);
        packer.packString("x").packFloat((float) light[0]);
        packer.packString("y").packFloat((float) light[1]);
        packer.packString("intensity").packFloat((float) light[2]);
      }
    }
    if (!scene.styles().isEmpty()) {
      packer.packString("styles").packArrayHeader(scene.styles().size());
      for (String[] style : scene.styles()) {
        packer.packMapHeader(4);
        packer.packString("kind").packString(style[0]).packString("state").packString(style[1]);
        packer.packString("color").packString(style[2]).packString("shape").packString(style[3]);
      }
    }
    if (scene.scale() != null) {
      packer.packString("scale").packMapHeader(3);
      packer.packString("name").packString(scene.scale().name);
      packer.packString("low").packFloat((float) scene.scale().low);
      packer.packString("high").packFloat((float) scene.scale().high);
    }
  }

  private void patch(Scene.Patch patch) throws IOException {
    packer.packMapHeader(4).packString("grey").packFloat((float) patch.grey);
    points(patch.points);
    packer.packString("radius").packFloat((float) patch.radius);
    packer.packString("name").packString(patch.name);
  }

  private void points(double[] points) throws IOException {
    packer.packString("points").packArrayHeader(points.length / 2);
    for (int i = 0; i < points.length; i += 2) {
      MessagePacker point = packer.packArrayHeader(2);
      point.packFloat((float) points[i]).packFloat((float) points[i + 1]);
    }
  }

  private static <T> int[] numbers(List<T> items, ToIntFunction<T> of) {
    return items.stream().mapToInt(of).toArray();
  }

  private static int[] flat(List<int[]> pairs) {
    List<Integer> numbers = new ArrayList<>();
    for (int[] pair : pairs) {
      numbers.add(pair[0]);
      numbers.add(pair[1]);
    }
    return numbers(numbers, Integer::intValue);
  }

  private void indices(String name, int[] numbers) throws IOException {
    ByteBuffer bytes =
        ByteBuffer.allocate(Integer.BYTES * numbers.length).order(ByteOrder.LITTLE_ENDIAN);
    bytes.asIntBuffer().put(numbers);
    packer.packString(name).packBinaryHeader(bytes.capacity()).writePayload(bytes.array());
  }

  private <T> void singles(String name, List<T> items, ToDoubleFunction<T> of) throws IOException {
    ByteBuffer bytes =
        ByteBuffer.allocate(Float.BYTES * items.size()).order(ByteOrder.LITTLE_ENDIAN);
    for (T item : items) {
      bytes.putFloat((float) of.applyAsDouble(item));
    }
    packer.packString(name).packBinaryHeader(bytes.capacity()).writePayload(bytes.array());
  }
}
