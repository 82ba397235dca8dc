// Sizes: [height, width] here, as pixels lie; WIDTHxHEIGHT in every text, as on the command line.

/** [height, width] of `512` or `768x512`. */
export function sides(text: string): [number, number] {
  const [width, height] = text.split("x").map(Number);
  return [height ?? width, width];
}

/** Pixels of the screen along the longer side of an element, up to which previews in it get finer. */
export function screenPixels(element: HTMLElement | null): number {
  return element ? Math.ceil(devicePixelRatio * Math.max(element.clientWidth, element.clientHeight)) : 0;
}

/** [height, width] as `768x512`. */
export function sizeText([height, width]: [number, number]): string {
  return `${width}x${height}`;
}
