// Unpacks what the page is made of, and starts it. Everything is deflated and in base64 in elements of the page.
(async () => {
  const message = document.getElementById('message');
  const say = (text) => {
    message.textContent = text;
    message.className = text ? 'warning' : '';
  };
  const bytesOf = (text) => {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
    const characters = atob(text);
    const bytes = new Uint8Array(characters.length);
    for (let k = 0; k < bytes.length; k++) bytes[k] = characters.charCodeAt(k);
    return bytes;
  };
  const unpack = (element) => {
    const packed = new Blob([bytesOf(element.textContent)]);
    element.remove();
    return new Response(packed.stream().pipeThrough(new DecompressionStream('deflate-raw'))).arrayBuffer();
  };
  if (typeof DecompressionStream === 'undefined') {
    say('This browser cannot unpack the page (it has no DecompressionStream). Any browser since 2023 can.');
    return;
  }
  try {
    // Modules have no addresses in a file: they get some, and an import map says which name has which.
    const imports = {};
    await Promise.all(Array.from(document.querySelectorAll('[data-module]'), async (element) => {
      const text = await unpack(element);
      imports[element.dataset.module] = URL.createObjectURL(new Blob([text], { type: 'text/javascript' }));
    }));
    const map = document.createElement('script');
    map.type = 'importmap';
    map.textContent = JSON.stringify({ imports });
    document.head.append(map);
    const data = JSON.parse(document.getElementById('data').textContent);
    const elements = new Map(Array.from(document.querySelectorAll('[data-array]'), (e) => [e.dataset.array, e]));
    const { start } = await import('page/main');
    await start(data, (name) => unpack(elements.get(name)), say);
    message.remove();
    document.body.dataset.ready = 'yes';
  } catch (error) {
    say(`The page cannot be drawn: ${error.message}`);
    document.body.dataset.ready = 'no';
    console.warn(error);
  }
})();
