// Whether this browser draws 3-D pictures: the server is told before it sends any.
window.dash_clientside = Object.assign({}, window.dash_clientside, {
  workbench: {
    hasWebgl: () => {
      const canvas = document.createElement("canvas");
      return Boolean(canvas.getContext("webgl") || canvas.getContext("experimental-webgl"));
    },
  },
});
