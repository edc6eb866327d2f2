// What pages have in common that are light or dark: as chosen in this browser, else as the computer is set.
export default {
  data() {
    return { isDark: false };
  },
  mounted() {
    const chosen = localStorage.getItem("robocorba-dark");
    this.setDark(chosen ? chosen === "yes" : window.matchMedia("(prefers-color-scheme: dark)").matches);
  },
  methods: {
    toggleDark() {
      this.setDark(!this.isDark);
      localStorage.setItem("robocorba-dark", this.isDark ? "yes" : "no");
    },
    setDark(isDark) {
      this.isDark = isDark;
      this.$q.dark.set(isDark);
      window.dispatchEvent(new Event("robocorba-colors"));
    },
  },
};
