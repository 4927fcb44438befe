/* A page that is opened from a file may start no worker: the search then runs in a hidden frame of the page. */
if (location.protocol === "file:")
  window.Worker = class {
    constructor(address) {
      const url = new URL(address, location.href).href;
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      this.begun = new Promise((resolve, reject) => {
        this.frame.onload = () => {
          const inside = this.frame.contentWindow;
          inside.postMessage = (data) => setTimeout(() => this.onmessage?.({ data }));
          const script = inside.document.createElement("script");
          script.onload = () => resolve(inside);
          script.onerror = reject;
          script.src = url;
          inside.document.head.append(script);
        };
      });
      this.begun.catch((event) => this.onerror?.(event));
      document.body.append(this.frame);
    }

    postMessage(data) {
      this.begun.then((inside) => inside.onmessage({ data }), () => {});
    }

    terminate() {
      this.frame.remove();
    }
  };
