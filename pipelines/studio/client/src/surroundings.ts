// What lights a material from all sides, computed here: radiance by direction, as an HDRI has it.
import { DataTexture, EquirectangularReflectionMapping, FloatType, LinearFilter } from "three";
import type { Surroundings } from "./scene-look";

type Rgb = readonly [number, number, number];
/** Radiance from the elevation of a direction and its angle around from the light, radians. */
type Radiance = (elevation: number, around: number) => Rgb;

const [WIDTH, HEIGHT] = [256, 128];
const SUN = 0.7; // its elevation, radians

const mixed = (one: Rgb, other: Rgb, share: number): Rgb => [0, 1, 2].map((at) => one[at] + share * (other[at] - one[at])) as unknown as Rgb;
const plus = (one: Rgb, other: Rgb, times: number): Rgb => mixed(one, [0, 1, 2].map((at) => one[at] + other[at]) as unknown as Rgb, times);
/** 1 up to a distance, 0 from twice the softness farther on. */
const soft = (distance: number, reach: number, softness: number): number => {
  const share = Math.min(1, Math.max(0, (reach + softness - distance) / (2 * softness)));
  return share * share * (3 - 2 * share);
};
/** A lamp with a wide screen. */
const screen = (elevation: number, around: number, at: readonly [number, number], size: readonly [number, number]): number =>
  soft(Math.abs(elevation - at[0]), size[0], 0.06) * soft(Math.abs(Math.atan2(Math.sin(around - at[1]), Math.cos(around - at[1]))), size[1], 0.06);
/** Cosine of the angle to the sun. */
const toSun = (elevation: number, around: number, sun: number): number =>
  Math.max(0, Math.sin(elevation) * Math.sin(sun) + Math.cos(elevation) * Math.cos(sun) * Math.cos(around));
const sky = (elevation: number, horizon: Rgb, zenith: Rgb, ground: Rgb): Rgb =>
  mixed(ground, mixed(horizon, zenith, Math.sqrt(Math.max(0, Math.sin(elevation)))), soft(-elevation, 0, 0.04));

const RADIANCE: Record<Surroundings, Radiance> = {
  studio: (elevation, around) => {
    const key = screen(elevation, around, [0.75, 0], [0.3, 0.6]);
    const fill = screen(elevation, around, [0.35, Math.PI], [0.3, 0.5]);
    const above = soft(Math.PI / 2 - elevation, 0.3, 0.1);
    return plus(plus(plus(sky(elevation, [0.5, 0.5, 0.52], [0.35, 0.35, 0.37], [0.22, 0.21, 0.2]), [9, 8.8, 8.4], key), [2.4, 2.6, 3], fill), [4, 4, 4], above);
  },
  sky: (elevation, around) => {
    const near = toSun(elevation, around, SUN);
    return plus(sky(elevation, [1.5, 1.75, 2], [0.3, 0.6, 1.35], [0.5, 0.45, 0.38]), [14, 12, 9], elevation < 0 ? 0 : near ** 80 + 0.06 * near ** 6);
  },
  overcast: (elevation) => sky(elevation, [0.75, 0.78, 0.82], [2.1, 2.2, 2.3], [0.4, 0.39, 0.37]),
  evening: (elevation, around) => {
    const near = toSun(elevation, around, 0.08);
    return plus(sky(elevation, [1, 0.62, 0.5], [0.2, 0.26, 0.48], [0.2, 0.15, 0.13]), [12, 5, 1.6], elevation < 0 ? 0 : near ** 40 + 0.14 * near ** 3);
  },
};

/** Surroundings whose light comes from the x axis, with y up. */
export function surroundings(name: Surroundings): DataTexture {
  const data = new Float32Array(4 * WIDTH * HEIGHT);
  for (let row = 0; row < HEIGHT; row += 1) {
    for (let column = 0; column < WIDTH; column += 1) {
      const radiance = RADIANCE[name](((row + 0.5) / HEIGHT - 0.5) * Math.PI, ((column + 0.5) / WIDTH - 0.5) * 2 * Math.PI);
      data.set([...radiance, 1], 4 * (row * WIDTH + column));
    }
  }
  const texture = new DataTexture(data, WIDTH, HEIGHT);
  [texture.type, texture.mapping] = [FloatType, EquirectangularReflectionMapping];
  [texture.minFilter, texture.magFilter, texture.needsUpdate] = [LinearFilter, LinearFilter, true];
  return texture;
}
