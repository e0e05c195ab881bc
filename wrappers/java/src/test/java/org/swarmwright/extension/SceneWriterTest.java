package org.swarmwright.extension;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertThrows;

import java.io.IOException;
import java.util.List;
import java.util.Map;
import org.junit.jupiter.api.Test;
import org.msgpack.core.MessagePack;
import org.msgpack.value.MapValue;
import org.msgpack.value.Value;
import org.msgpack.value.ValueFactory;
import org.swarmwright.Scene;

/** Scenes as messages. */
class SceneWriterTest {
  private static final SceneWriter.Head HEAD =
      new SceneWriter.Head(3, "h", 4, -1.5, Map.of(), 0.25);

  private static Map<Value, Value> written(Scene scene) throws IOException {
    byte[] bytes = SceneWriter.write(scene, HEAD, List.of());
    MapValue value = MessagePack.newDefaultUnpacker(bytes).unpackValue().asMapValue();
    return value.map();
  }

  @Test
  void theOriginIsWrittenWhereItIsNotTheCorner() throws IOException {
    Map<Value, Value> moved = written(new Scene(4, 3).origin(-2, 0.5).message("Hello"));
    List<Value> origin = moved.get(ValueFactory.newString("origin")).asArrayValue().list();
    assertEquals(-2, origin.get(0).asFloatValue().toDouble());
    assertEquals(0.5, origin.get(1).asFloatValue().toDouble());
    assertEquals("Hello", moved.get(ValueFactory.newString("message")).asStringValue().asString());
    Map<Value, Value> plain = written(new Scene(4, 3).message("Hello"));
    assertEquals(moved.size() - 1, plain.size());
  }

  @Test
  void theOriginIsFinite() {
    Scene scene = new Scene(4, 3);
    assertThrows(IllegalArgumentException.class, () -> scene.origin(Double.NaN, 0));
    assertThrows(IllegalArgumentException.class, () -> scene.origin(0, Double.NEGATIVE_INFINITY));
  }
}
