package org.swarmwright;

import java.util.ArrayList;
import java.util.List;
import java.util.Objects;

/**
 * What an episode looks like from above at one step, for tools that show it elsewhere. Lengths are
 * in one unit, metres or cells; (0, 0) is at the bottom left; angles are radians,
 * counter-clockwise.
 *
 * <pre>{@code
 * Scene scene = new Scene(13, 7);
 * scene.body("goal", 12.5, 3.5).radius(0.5);
 * scene.body("agent", x, y).state("free").heading(angle);
 * }</pre>
 */
public final class Scene {
  /** Extent in x and y. */
  public final double width;

  /** Extent in y. */
  public final double height;

  private double[] origin = {0, 0};
  private boolean grid;
  private String message = "";
  private final List<Body> bodies = new ArrayList<>();
  private final List<Ray> rays = new ArrayList<>();
  private final List<int[]> links = new ArrayList<>();
  private Patch floor;
  private final List<Patch> patches = new ArrayList<>();
  private final List<Wall> walls = new ArrayList<>();
  private final List<double[]> lights = new ArrayList<>();
  private final List<String[]> styles = new ArrayList<>();
  private Scale scale;

  /**
   * An empty world.
   *
   * @throws IllegalArgumentException if an extent is not a finite number above 0
   */
  public Scene(double width, double height) {
    if (!(width > 0 && height > 0) || Double.isInfinite(width + height)) {
      throw new IllegalArgumentException(
          "a scene is larger than 0 in both directions; found " + width + " x " + height);
    }
    this.width = width;
    this.height = height;
  }

  /** The unit is a cell; people number cells from the top left. */
  public Scene grid() {
    grid = true;
    return this;
  }

  /**
   * Where the bottom left corner is in the simulation's own coordinates: numbers beside pictures
   * are those. Positions of the scene stay distances from that corner.
   *
   * @throws IllegalArgumentException if a number is not finite
   */
  public Scene origin(double x, double y) {
    if (!Double.isFinite(x) || !Double.isFinite(y)) {
      throw new IllegalArgumentException("the origin of a scene is (" + x + ", " + y + ")");
    }
    origin = new double[] {x, y};
    return this;
  }

  /** A line to show above. */
  public Scene message(String line) {
    message = Objects.requireNonNull(line, "message");
    return this;
  }

  /**
   * Adds a body, above those that are there.
   *
   * @param kind agent, defender, goal, exit, obstacle, or any other word
   */
  public Body body(String kind, double x, double y) {
    Body body = new Body(bodies.size(), Objects.requireNonNull(kind, "kind"), x, y);
    bodies.add(body);
    return body;
  }

  /**
   * Adds what a sensor looks along.
   *
   * @param angle from the heading of the body
   * @param start where it begins, from the middle of the body
   * @param length how far it goes from there
   * @param reading what the sensor reads, 0 to 1; NaN for nothing
   */
  public Scene ray(Body body, double angle, double start, double length, double reading) {
    rays.add(new Ray(body.index, angle, start, length, reading));
    return this;
  }

  /** Adds a line between two bodies, of which the second hears the first. */
  public Scene link(Body from, Body to) {
    links.add(new int[] {from.index, to.index});
    return this;
  }

  /** The colour of the whole floor, 0 black to 1 white. */
  public Scene floor(double grey) {
    floor = new Patch(grey, "", 0);
    return this;
  }

  /** Adds a circle on the floor with a grey of its own, 0 black to 1 white. */
  public Scene circle(double x, double y, double radius, double grey, String name) {
    patches.add(new Patch(grey, name, radius, x, y));
    return this;
  }

  /** Adds a polygon on the floor with a grey of its own; corners x, y, x, y, ... in order. */
  public Scene polygon(double grey, String name, double... corners) {
    patches.add(new Patch(grey, name, 0, corners));
    return this;
  }

  /** Adds a wall from point to point: x, y, x, y, ... */
  public Scene wall(double... points) {
    walls.add(new Wall(false, points));
    return this;
  }

  /** Adds an obstacle with these corners: x, y, x, y, ... */
  public Scene obstacle(double... corners) {
    walls.add(new Wall(true, corners));
    return this;
  }

  /** Adds a lamp; its intensity is 0 while it is off. */
  public Scene light(double x, double y, double intensity) {
    lights.add(new double[] {x, y, intensity});
    return this;
  }

  /**
   * Chooses the look of bodies of a kind and state.
   *
   * @param state empty for all states that have no style
   * @param color #rrggbb, or empty for the default
   * @param shape circle, cross, triangle, star, square, diamond, pentagon, hexagon, or empty
   */
  public Scene style(String kind, String state, String color, String shape) {
    styles.add(new String[] {kind, state, color, shape});
    return this;
  }

  /** Says what the values of bodies are, and which ones have the first and the last colour. */
  public Scene scale(String name, double low, double high) {
    scale = new Scale(Objects.requireNonNull(name, "name"), low, high);
    return this;
  }

  /** Where the bottom left corner is in the simulation's own coordinates, x and y. */
  public double[] origin() {
    return origin.clone();
  }

  /** Whether the unit is a cell. */
  public boolean isGrid() {
    return grid;
  }

  /** A line to show above. */
  public String message() {
    return message;
  }

  /** What there is, what lies below first. */
  public List<Body> bodies() {
    return List.copyOf(bodies);
  }

  /** What sensors look along. */
  public List<Ray> rays() {
    return List.copyOf(rays);
  }

  /** Pairs of indices of bodies, of which the second hears the first. */
  public List<int[]> links() {
    return List.copyOf(links);
  }

  /** The floor; null for one without colour. */
  public Patch floor() {
    return floor;
  }

  /** Parts of the floor, what lies below first. */
  public List<Patch> patches() {
    return List.copyOf(patches);
  }

  /** Walls and obstacles. */
  public List<Wall> walls() {
    return List.copyOf(walls);
  }

  /** Lamps: x, y, intensity. */
  public List<double[]> lights() {
    return List.copyOf(lights);
  }

  /** Looks: kind, state, color, shape. */
  public List<String[]> styles() {
    return List.copyOf(styles);
  }

  /** What the values of bodies are; null where that is not said. */
  public Scale scale() {
    return scale;
  }

  /** One thing in a scene. */
  public static final class Body {
    /** Where it is among the bodies. */
    public final int index;

    /** What it is. */
    public final String kind;

    /** Position. */
    public final double x;

    /** Position, upwards. */
    public final double y;

    private String state = "";
    private double radius;
    private double heading = Double.NaN;
    private double value = Double.NaN;
    private int agent = -1;
    private String label = "";

    private Body(int index, String kind, double x, double y) {
      this.index = index;
      this.kind = kind;
      this.x = x;
      this.y = y;
    }

    /** How it fares: free, arrived, caught, crashed, out, or any other word. */
    public Body state(String word) {
      state = Objects.requireNonNull(word, "state");
      return this;
    }

    /** Its size; 0, the default, is a point. */
    public Body radius(double length) {
      radius = length;
      return this;
    }

    /** Where it looks, from the x axis. Bodies with a heading are drawn in their true size. */
    public Body heading(double angle) {
      heading = angle;
      return this;
    }

    /** A number that gives it a colour, see {@link Scene#scale(String, double, double)}. */
    public Body value(double number) {
      value = number;
      return this;
    }

    /** Which agent it is; without it, bodies of the kind agent are the agents in their order. */
    public Body agent(int number) {
      agent = number;
      return this;
    }

    /** A short text beside it. */
    public Body label(String text) {
      label = Objects.requireNonNull(text, "label");
      return this;
    }

    /** How it fares. */
    public String state() {
      return state;
    }

    /** Its size. */
    public double radius() {
      return radius;
    }

    /** Where it looks; NaN for nowhere. */
    public double heading() {
      return heading;
    }

    /** A number that gives it a colour; NaN for none. */
    public double value() {
      return value;
    }

    /** Which agent it is; -1 if that is not said. */
    public int agent() {
      return agent;
    }

    /** A short text beside it. */
    public String label() {
      return label;
    }
  }

  /** A sensor's line of sight. */
  public static final class Ray {
    /** Index of its body. */
    public final int body;

    /** Angle, start, length, reading. */
    public final double[] numbers;

    private Ray(int body, double... numbers) {
      this.body = body;
      this.numbers = numbers;
    }
  }

  /** A part of the floor: a circle around its only point, or a polygon. */
  public static final class Patch {
    /** 0 black to 1 white. */
    public final double grey;

    /** What legends call it. */
    public final String name;

    /** Of a circle. */
    public final double radius;

    /** x, y, x, y, ... */
    public final double[] points;

    private Patch(double grey, String name, double radius, double... points) {
      this.grey = grey;
      this.name = Objects.requireNonNull(name, "name");
      this.radius = radius;
      this.points = paired(points);
    }
  }

  /** A wall, or an obstacle. */
  public static final class Wall {
    /** Whether the points are the corners of something solid. */
    public final boolean solid;

    /** x, y, x, y, ... */
    public final double[] points;

    private Wall(boolean solid, double... points) {
      this.solid = solid;
      this.points = paired(points);
    }
  }

  /** The range of the values of bodies. */
  public static final class Scale {
    /** What the values are, with their unit. */
    public final String name;

    /** The value with the first colour. */
    public final double low;

    /** The value with the last colour. */
    public final double high;

    private Scale(String name, double low, double high) {
      this.name = name;
      this.low = low;
      this.high = high;
    }
  }

  private static double[] paired(double[] points) {
    if (points.length % 2 != 0) {
      throw new IllegalArgumentException(
          points.length + " numbers are not points: x, y, x, y, ...");
    }
    return points.clone();
  }
}
